"""Parts of the atlas of speed against accuracy: fluids, drivers, sampling, timing, errors, figures and the page."""
