"""What the edges promise each other: Protocols, plain values, and the frozen configuration.

Nothing here does anything. Adapters implement these, the node joins them, and no foreign type
(a pymavlink message, a Zenoh sample, an OpenCV array) appears in a signature.
"""
