"""Design of soft parts: finite elements, topology optimisation, and robots from parts."""
