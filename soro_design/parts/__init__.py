"""Parts from files: what they are, how they are loaded, and what a run of them leaves."""
