"""From a wished generalised force to set points of the pressures."""
