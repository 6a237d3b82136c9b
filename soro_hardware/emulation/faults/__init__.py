"""Faults of emulated devices: names, times and effects."""
