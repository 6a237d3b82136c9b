"""External force: its estimate at the tip, and the stages of a contact."""
