"""Schemas and keys of the outside."""
