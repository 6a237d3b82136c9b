"""One MCAP file: its records, by its index or one after the other."""
