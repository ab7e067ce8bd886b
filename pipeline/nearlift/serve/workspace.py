"""Campaigns and products of a workspace, by name and by path."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nearlift.errors import NearliftError


class NotThere(NearliftError):
    """The workspace holds no such campaign, file or page."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignFolder:
    """Folders of one campaign's products."""

    name: str
    processed: Path
    reports: Path


def campaigns(root: Path) -> list[str]:
    """Names of the campaigns that have trials, in order; none behind a link out of `root`."""
    tables = root.glob("processed/*/trials.parquet")
    return sorted(path.parent.name for path in tables if path.resolve().is_relative_to(root))


def place(root: Path, name: str) -> CampaignFolder:
    """Folders of the campaign of that name.

    Raises
    ------
    NotThere
        It was never run.
    """
    if name not in campaigns(root):
        raise NotThere(name, "is no campaign that was run here", "choose one of the list")
    return CampaignFolder(
        name=name, processed=root / "processed" / name, reports=root / "reports" / name
    )


def product(root: Path, relative: str) -> Path:
    """File of ``processed/`` or ``reports/``, links followed.

    Raises
    ------
    NotThere
        There is none, or a link or ``..`` leads out of the two folders.
    """
    try:
        path = (root / relative).resolve(strict=True)
    except (OSError, ValueError, RuntimeError):
        path = root
    homes = (root / "processed", root / "reports")
    if not (path.is_file() and any(path.is_relative_to(home) for home in homes)):
        raise NotThere(relative[:200], "is no product of this workspace", "run the campaign first")
    return path
