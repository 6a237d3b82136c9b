"""Links: their kinematics and inertia, section by section, as kernels."""
