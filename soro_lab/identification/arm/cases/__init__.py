"""What a fit compares: cases from recordings, and their prediction."""
