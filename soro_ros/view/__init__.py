"""The live view: an arm, its reference and its pressures in a browser, with buttons (docs/view.md)."""
