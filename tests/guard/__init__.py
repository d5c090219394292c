"""The runtime guard: the core run with every iteration, number and call watched, and the list of what is excused."""
