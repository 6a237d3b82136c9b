"""How an arm changes from run to run: the error of its model, its stiffness, what was learned, their trend."""
