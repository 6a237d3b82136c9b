"""Recorded runs: read, replayed, as tables."""
