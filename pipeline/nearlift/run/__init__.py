"""Running stages: what is stale, what a stage is given, and how what it writes gets to the disk
whole.
"""
