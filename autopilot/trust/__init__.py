"""Who may speak and how it is proved: documents, envelope, replay window, gate.

The envelope is made and judged here and nowhere else. Nothing here opens a socket, knows a Zenoh
key expression's form, or decides what an order may do: route checks are handed in, and target,
role, dedup and order sequence are the core's.
"""
