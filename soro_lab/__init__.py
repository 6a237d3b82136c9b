"""What a lab does with an arm: scenes, recordings, excitation, identification, analysis, reports."""
