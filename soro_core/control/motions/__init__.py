"""Motions of the tip: from paths to coordinates over time, past obstacles that a robot file knows."""
