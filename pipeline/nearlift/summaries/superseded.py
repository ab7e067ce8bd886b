"""Boundaries whose base model the loop has gone beyond: what concerns that model alone must say so."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nearlift.summaries.evidence import Evidence


def found(evidence: Evidence, boundary: str) -> Mapping[str, Any]:
    """The loop's findings at a boundary if it named an effect there; else nothing."""
    entry = evidence.diagnosed(boundary)
    return entry if entry.get("verdict") == "effect" else {}


def named(evidence: Evidence, boundary: str) -> str:
    """The effects that the loop named there, as a sentence has them; empty if none."""
    return " and ".join(str(e["name"]) for e in found(evidence, boundary).get("effects", []))


def warning(evidence: Evidence) -> str:
    """What a caption adds about such boundaries; empty where there are none, else it ends a sentence and leaves a space."""
    lines = [f"{b} ({named(evidence, b)})" for b in evidence.boundaries if found(evidence, b)]
    return f"The loop named an effect at the {', the '.join(lines)}, which is not in these models. " if lines else ""
