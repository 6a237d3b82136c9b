"""What the model says of an arm before it moves: stiffness, natural frequencies, modes, places of sensors."""
