"""Exported velocity grids: one file per dialect behind one seam, told apart by what stands in the
file.
"""

from nearlift.readers.piv.sniff import DIALECTS, dialect, read, told_apart
from nearlift.readers.piv.vectors import Dialect, Raw, Setting, settle

__all__ = ["DIALECTS", "Dialect", "Raw", "Setting", "dialect", "read", "settle", "told_apart"]
