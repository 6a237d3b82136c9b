"""Nonlinear finite elements of soft parts (docs/design.md): materials, meshes, loads and Newton's method."""
