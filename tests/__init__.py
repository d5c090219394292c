"""Tests: they mirror the packages; what concerns the whole house lies at the top."""
