"""Models fitted to trials: least squares, profiles, posteriors, checks of assumptions."""
