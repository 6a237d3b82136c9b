"""Identification of an arm: its numbers from recordings, how sure each is, and which law the data ask for."""
