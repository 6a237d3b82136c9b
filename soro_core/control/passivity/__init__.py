"""The passivity-based adaptive law: what it adapts, and within which bounds."""
