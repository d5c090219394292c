"""Golden flights: small logs that every version must replay as it is written beside them. `table.py` says why each."""
