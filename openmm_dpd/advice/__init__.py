"""Advice on scheme and step size, from measured tables of fluids and from vibrations of bonds and angles under any word."""
