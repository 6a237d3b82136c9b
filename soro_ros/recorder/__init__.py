"""Parts of the recorder and the player."""
