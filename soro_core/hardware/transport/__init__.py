"""Ways to a bus: CAN frames over serial lines and pseudo-terminals."""
