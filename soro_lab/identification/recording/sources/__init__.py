"""Where recordings come from: bags, CSV files, and hands that bend an arm."""
