"""Exported velocity grids: one file per dialect, told apart by what stands in the file."""
