"""Where products go: ``processed/`` and ``reports/`` stand beside ``raw/``, never within it or
within a campaign's folder.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from nearlift.errors import UsageError


def workspace(campaigns: Iterable[Path]) -> Path:
    """The folder for products unless another is named: the current one.

    From within the folder ``raw`` in which the first of `campaigns` lies, it is the folder that
    holds ``raw``.
    """
    here = Path.cwd()
    for campaign in campaigns:
        raw = next((above for above in campaign.resolve().parents if above.name == "raw"), None)
        return raw.parent if raw is not None and here.is_relative_to(raw) else Path()
    return Path()


def spare_raw(campaign: Path, out: Path) -> None:
    """See that no product goes where measurements lie.

    Raises
    ------
    UsageError
        `out` is the campaign's folder, or lies in it.
    """
    if campaign.is_dir() and out.resolve().is_relative_to(campaign.resolve()):
        raise UsageError(
            "--out",
            f"{str(out.resolve())!r} lies in the campaign's folder, where nothing is written",
            "name a folder outside it",
        )
