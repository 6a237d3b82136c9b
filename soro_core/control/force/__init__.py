"""Force at the tip: press with a stated one, bound any, and a stated stiffness."""
