"""What a fit compares and what it may change: cases, predictions, numbers of an arm."""
