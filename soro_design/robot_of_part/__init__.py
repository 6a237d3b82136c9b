"""Robot files of parts that are computed by finite elements (docs/parts.md)."""
