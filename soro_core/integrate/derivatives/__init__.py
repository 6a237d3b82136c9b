"""Derivatives of a step by its start and its input."""
