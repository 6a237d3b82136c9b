"""Emulated regulators: a process that exchanges the devices' bytes, with the air of their chambers."""
