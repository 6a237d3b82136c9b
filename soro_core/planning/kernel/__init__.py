"""Compiled parts of the planning."""
