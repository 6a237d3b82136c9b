"""Host ends of emulated lines in the same process, for tests and benchmarks; not used at run time."""
