"""Elements, materials and loads as kernels."""
