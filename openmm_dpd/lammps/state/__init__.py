"""The state of a deck as data, in the deck's own numbers, and its values at one moment."""
