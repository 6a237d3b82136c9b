"""VEAB boards of the published desktop platform, behind their TCP server."""
