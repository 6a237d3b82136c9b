"""Ways of a whole arm around known obstacles, in pressures that can be held."""
