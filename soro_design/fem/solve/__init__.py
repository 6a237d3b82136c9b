"""Equilibrium and motion of a part."""
