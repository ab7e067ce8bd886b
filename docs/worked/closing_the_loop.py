"""Make again the figures of docs/closing-the-loop.md, and README's Figure 2:
``python docs/worked/closing_the_loop.py OUT [PITT]``.

Runs the demo, and the measured campaign pitt-ras-2017 if its folder PITT is given, into OUT, and
puts reduced copies of the figures into docs/figures.
"""

import sys
from pathlib import Path

from click.testing import CliRunner
from PIL import Image

from nearlift.cli import main

FIGURES = Path(__file__).resolve().parent.parent / "figures"
WIDTH = 1350


def nearlift(*words: object) -> None:
    """One command."""
    answer = CliRunner().invoke(main, [str(w) for w in words])
    # 3: some trials are left out, each listed with its reason
    assert answer.exit_code in (0, 3), answer.output


def keep(source: Path, name: str) -> None:
    """A copy for the page: as wide as a page on a screen, in few colours."""
    picture = Image.open(source).convert("RGB")
    small = picture.resize(
        (WIDTH, round(picture.height * WIDTH / picture.width)), Image.Resampling.LANCZOS
    )
    few = small.quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(FIGURES / f"{name}.png", optimize=True)


if __name__ == "__main__":
    out = Path(sys.argv[1])
    nearlift("demo", "--out", out, "-q")
    reports = out / "reports"
    keep(reports / "demo/fig2.png", "fig2-demo")
    keep(reports / "demo/diagnosis.png", "loop-demo")
    if len(sys.argv) > 2:
        pitt = Path(sys.argv[2])
        nearlift("run", pitt, "--out", out, "-q")
        keep(reports / "pitt-ras-2017/diagnosis.png", "loop-pitt")
