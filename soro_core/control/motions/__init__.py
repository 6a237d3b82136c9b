"""Motions of the tip along paths: from the path to coordinates over time."""
