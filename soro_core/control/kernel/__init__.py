"""Compiled parts of the controller's tick."""
