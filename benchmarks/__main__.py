"""Every benchmark, one after the other, each in a process of its own: ``make bench``."""

import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent

for script in sorted(p for p in HERE.glob("*.py") if not p.name.startswith("__")):
    print(f"== {script.stem}", flush=True)
    if code := subprocess.call([sys.executable, str(script), *sys.argv[1:]]):
        sys.exit(code)
