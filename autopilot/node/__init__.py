"""The present: the loop that records, decides, commits and performs, and what joins it to its adapters."""
