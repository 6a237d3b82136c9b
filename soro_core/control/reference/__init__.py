"""References in coordinates of the arm: where it ought to be, and the way from one to the next."""
