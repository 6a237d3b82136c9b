"""The server on the Raspberry Pi: what `soro board` runs."""
