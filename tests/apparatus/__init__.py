"""Faults, damaged messages, extreme numbers: tests run a part, `python -m tests.apparatus` runs all."""
