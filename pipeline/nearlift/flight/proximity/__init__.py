"""Boundary proximity from a lift ratio or a hover throttle. Opens no file, draws nothing."""
