"""Emulated regulators: a process that speaks the devices' bytes, with the air behind them."""
