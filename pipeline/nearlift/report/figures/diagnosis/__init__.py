"""The figure `diagnosis`: residual, candidates, held-out error and coefficient of each boundary."""
