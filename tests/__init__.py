"""Tests; what is set here is set before any of them imports numpy."""

import os

# Where all cores are busy, as in a run of all tests, a second thread of BLAS makes small matrices slower: a
# call waits for it, for the exponential of a 4 x 4 matrix up to 10 ms instead of 0.01 ms.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
