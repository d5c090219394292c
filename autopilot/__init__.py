"""The present: daemon, adapters, ground tools, simulator and command line. Its floors are in ARCHITECTURE.md."""
