"""Elements, materials, fibres and pressures that follow the walls, as kernels."""
