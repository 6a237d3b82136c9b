"""An emulated soro board and its chips."""
