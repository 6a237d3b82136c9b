"""Benchmarks: what the model costs, beside a peer in the same run. ``python -m benchmarks --help``."""

import os

# As `soro` does.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
