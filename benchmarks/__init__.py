"""Each benchmark beside its peer, in one run: ratios count, times are orientation."""
