"""Equilibria of an arm under constant pressures."""
