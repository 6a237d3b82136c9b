"""References: where the arm ought to be, and whether it can be there."""
