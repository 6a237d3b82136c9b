"""Steppers in time, one a file, as coefficients of two kernels."""
