"""Optimisation of the stated dimensions of a part: what a design reaches, the search, its report."""
