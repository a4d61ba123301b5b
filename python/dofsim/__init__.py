"""Depth of field as a real lens would have taken it."""
