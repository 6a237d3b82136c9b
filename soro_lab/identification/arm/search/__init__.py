"""The search for the numbers of an arm, and how sure they are."""
