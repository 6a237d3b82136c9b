"""Parts of the learner: its state, what it keeps under a push, bounds, and the evidence for slopes."""
