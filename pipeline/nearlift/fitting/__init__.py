"""Models against trials: the likelihood, least squares, posteriors. Pure: arrays in, frozen results
out.
"""
