"""Words by which nodes begin what they say when they have nothing to give; without ROS, for who reads it."""

# Of a controller while it sends no command, and of an estimator without an estimate.
NO_COMMAND, NO_ESTIMATE = "no command", "no estimate"


def add_prefix(prefix: str, text: str) -> str:
    """Return a text that begins with one of the words above, once; an empty one stays empty."""
    return text if not text or text.startswith(prefix) else f"{prefix}: {text}"
