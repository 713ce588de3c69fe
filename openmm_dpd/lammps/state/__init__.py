"""What a deck has said so far, as data in its own numbers, and what it is at one moment."""
