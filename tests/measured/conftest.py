"""The package `measured` lies in the repository's root, where an installation does not look."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2]))
