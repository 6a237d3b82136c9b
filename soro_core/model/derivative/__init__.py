"""Exact derivatives of the dynamics by coordinates, velocities and accelerations, docs/model.md."""
