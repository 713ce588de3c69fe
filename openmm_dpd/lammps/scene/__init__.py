"""Scenes from the state of a deck."""
