"""Regulators, pumps and leaks from recordings: which stage a recording has, and what each stage found."""
