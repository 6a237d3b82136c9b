"""From a desired generalised force to set points of the pressures."""
