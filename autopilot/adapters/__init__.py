"""The edges of the daemon. None knows another; foreign types stop here."""
