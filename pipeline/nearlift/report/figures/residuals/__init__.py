"""Residuals of the base model against every covariate, on paper and as an interactive chart."""
