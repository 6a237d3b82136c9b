"""Commands that need devices or emulated ones."""
