"""Bundle Vega, Vega-Lite and vega-embed as `report/page/vendor/vega.js`, from the vl-convert that the
lock names; a test holds the two together.
"""

from __future__ import annotations

from pathlib import Path

import vl_convert

VENDORED = (
    Path(__file__).parent.parent
    / "pipeline"
    / "nearlift"
    / "report"
    / "page"
    / "vendor"
    / "vega.js"
)

if __name__ == "__main__":
    VENDORED.write_text(vl_convert.javascript_bundle(), encoding="utf-8")
