"""Compiled part of the learner."""
