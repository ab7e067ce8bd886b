"""Vertical flight near a boundary: crash rates, energy and routes. Opens no file, draws nothing."""
