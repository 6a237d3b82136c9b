"""The bodies of a recorded run: where they were, and their figures."""
