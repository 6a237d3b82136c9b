"""Multigrid of large solids: levels by smoothed aggregation, and the kernels of its sweeps."""
