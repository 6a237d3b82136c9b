"""Obstacles that a robot file knows: how near the arm comes, and what is refused for it."""
