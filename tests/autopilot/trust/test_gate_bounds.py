"""The gate at its bounds: the last value that passes and the first that does not, for every number in it."""

from __future__ import annotations
