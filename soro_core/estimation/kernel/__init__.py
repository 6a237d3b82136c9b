"""Kernels of the filter: prediction and update of mean and covariance, compiled."""
