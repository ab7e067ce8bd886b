"""Exported velocity grids: one file per dialect behind one seam, told apart by what stands in the
file.
"""

from nearlift.readers.piv.seam import Dialect, Raw, Setting, settle
from nearlift.readers.piv.sniff import DIALECTS, dialect, read, told_apart

__all__ = ["DIALECTS", "Dialect", "Raw", "Setting", "dialect", "read", "settle", "told_apart"]
