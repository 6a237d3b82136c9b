"""Meshes: made from dimensions, read from files, written for other programs."""
