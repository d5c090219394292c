"""The past, run again: the same code on the recorded observations. It changes no log."""
