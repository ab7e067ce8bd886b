"""Trials to the likelihood of one problem: means, covariance, sizes of the noise, budget."""
