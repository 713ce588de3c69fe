"""From the state of a deck to a Scene."""
