"""Exported velocity grids: one file per dialect behind one seam, told apart by what stands in the
file.
"""
