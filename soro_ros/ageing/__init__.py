"""How an arm changes from run to run: error of its model, stiffness, learned numbers, their trend."""
