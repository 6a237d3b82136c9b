"""Emulated regulators on serial lines."""
