"""A node as a process: its start, its parameters, its life and its end."""
