"""Pictures, films and pages of recorded runs."""
