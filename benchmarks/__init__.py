"""Benchmarks: what the model costs, beside a peer in the same run. ``python -m benchmarks --help``."""
