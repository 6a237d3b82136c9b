"""Samples of the sensors, and the watch over them."""
