"""Commands for parts and their design."""
