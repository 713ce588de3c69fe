"""Advice on scheme and step: the measured map of fluids, vibrations of bonds and angles under any word."""
