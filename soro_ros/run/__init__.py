"""A run: a scene as processes, watched to its end, and its verdict."""
