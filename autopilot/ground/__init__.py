"""The ground's side: the Directory that issues identities, and the issuer that gives orders.

Nothing here runs on the node.
"""
