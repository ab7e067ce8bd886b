"""Vertical flight near a boundary: what the fitted lift models mean for safety and energy. Opens no
file, draws nothing.
"""
