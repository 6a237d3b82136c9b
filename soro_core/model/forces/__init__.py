"""Forces on an arm, from inside and from outside, as kernels."""
