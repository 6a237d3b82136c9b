"""Topics of the nodes."""
