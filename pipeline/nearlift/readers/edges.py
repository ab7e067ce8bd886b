"""Where a record is cut: at the steps of a column or of the force itself, at lines of text, or into
windows; and whether what that leaves is worth it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nearlift.campaign.manifest import Campaign
from nearlift.campaign.segments import FEWEST_SAMPLES, LEVEL, Segments
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import guarded
from nearlift.readers.channel import Contents, RecordsDialect, pick
from nearlift.readers.per_file import Format
from nearlift.readers.seam import Record
from nearlift.reduction import cuts

#: Of the samples that are cut, kept pieces and their settling are this share at least; else what
#: is thrown away is the record.
WORTH = 0.25
#: What a marker says of its level.
NUMBER = re.compile(r"[-+]?\d+(?:[.,]\d+)?")
#: What kept pieces may move through of `hold` from end to end, and the share of them that may: a
#: ramp goes through all of it.
SLOPING, MOST_SLOPING = 0.6, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Opened:
    """A record that was read: all channels of its file, the force among them as `record`, the
    dialect it is in, and the lines of text that are marks, each with the number of samples above.
    """

    path: Path
    contents: Contents
    record: Record
    dialect: RecordsDialect
    marks: Sequence[tuple[int, str]] = ()


def edges_of(
    cut: Segments, opened: Opened, head: int, rate: float
) -> tuple[FloatArray | None, list[cuts.Cut], list[float]]:
    """The column cut by, if any; where the record behind its head is cut; each mark's level."""
    n, where = len(opened.record.force_N), str(opened.path)
    if cut.column is not None:
        values, only = _stepping(cut, opened)
        edges = [(head + a, head + b) for a, b in cuts.by_level(values[head:], cut.hold)]
        if only is not None:
            edges = [(a, b) for a, b in edges if values[a] == only]
        return values, edges, [np.nan] * len(edges)
    if cut.begin is not None:
        edges, levels = _between(cut, opened.marks, head, n)
        if not edges:
            raise InputRefused(
                where,
                f"has no line {cut.begin!r} with samples behind it",
                "mend begin under [segments]; it is a whole line, {level} stands for a number",
            )
        return None, edges, levels
    if cut.by == "windows":
        return None, [(head, n)], [np.nan]
    if cut.of is None:
        values, step = opened.record.force_N, cut.step_N()
    else:
        values = pick(opened.contents.channels, cut.of, "segments.of", where).values
        assert isinstance(cut.step, int | float)
        step = float(cut.step)
    _above_the_grain(values[head:], step, where)
    smallest = max(round((cut.settle + cut.shortest) * rate), 1)
    edges = [(head + a, head + b) for a, b in cuts.by_change(values[head:], step, smallest)]
    return values, edges, [np.nan] * len(edges)


def _stepping(cut: Segments, opened: Opened) -> tuple[FloatArray, float | None]:
    """The column that steps, a text's words as numbers, and the one value to keep, if one is."""
    n, path = len(opened.record.force_N), opened.path
    if isinstance(cut.only, str):
        from nearlift.readers.text import words_of

        words = guarded.call(words_of, path, opened.dialect, cut.by)[:n]
        if cut.only not in words:
            known = ", ".join(map(repr, sorted(set(words))[:8]))
            raise InputRefused(
                str(path), f"has no {cut.only!r} in column {cut.by!r}", f"it has {known}"
            )
        return np.array([float(word == cut.only) for word in words]), 1.0
    channel = pick(opened.contents.channels, cut.by, "segments.by", str(path))
    if len(channel.values) != n:
        raise InputRefused(
            str(path),
            f"has {n} samples of force and {len(channel.values)} of {channel.name!r}",
            "a record is cut by a column of the same clock",
        )
    return channel.values, None if cut.only is None else float(cut.only)


def _above_the_grain(values: FloatArray, step: float, where: str) -> None:
    """Refuse a step below three codes of a coarse converter: every code would be a plateau."""
    known = values[np.isfinite(values)]
    apart = np.abs(np.diff(known))
    moved = apart[apart > 0]
    grain = float(moved.min()) if len(moved) else 0.0
    if len(moved) < 0.5 * len(apart) and step < 3 * grain * (1 - 1e-9):
        raise InputRefused(
            where,
            f"a step of {step:.3g} is less than three of the converter's own ({grain:.3g})",
            "take a larger step under [segments]",
        )


def marks_of(
    form: Format, path: Path, campaign: Campaign
) -> tuple[list[tuple[int, str]], RecordsDialect]:
    """The lines of a text that begin or end a piece, each with the number of samples above it; and
    the dialect in which they are no samples.
    """
    from nearlift.readers import text

    cut, said = campaign.segments, campaign.records.dialect
    assert cut is not None
    if "ignore" not in form.options:
        raise ManifestError(
            "segments.by",
            f'"markers" are lines of a text, and reader = {form.name!r} has none',
            'take reader = "text", or by = a column',
        )
    lines = [line.replace(LEVEL, "*") for line in (cut.begin, cut.end) if line is not None]
    given = said.get("ignore", ())
    dialect = {**said, "ignore": [*(given if isinstance(given, list) else ()), *lines]}
    return guarded.call(text.marked, path, text.given(dialect), lines), dialect


def _between(
    cut: Segments, marks: Sequence[tuple[int, str]], head: int, n: int
) -> tuple[list[cuts.Cut], list[float]]:
    """Pieces from each line that begins one to the next mark, and the number in that line."""
    assert cut.begin is not None
    before, level, after = cut.begin.partition(LEVEL)
    ends = [row for row, _ in marks[1:]] + [n] * bool(marks)
    edges, levels = [], []
    for (row, line), end in zip(marks, ends, strict=True):
        begins = len(line) >= len(before + after) and line.startswith(before)
        if not (begins and line.endswith(after) and max(row, head) < min(end, n)):
            continue
        between = line[len(before) : len(line) - len(after)].strip()
        if NUMBER.fullmatch(between) if level else not between:
            edges.append((max(row, head), min(end, n)))
            levels.append(float(between.replace(",", ".")) if level else np.nan)
    return edges, levels


def worth_it(
    pieces: cuts.Cuts, edges: Sequence[cuts.Cut], settle: int, where: str, rate: float
) -> None:
    """Refuse a record of which hardly anything is kept, with what would keep half of it."""
    whole = sum(b - a for a, b in edges)
    kept = sum(p.end - p.first for p in pieces.pieces)
    if kept >= WORTH * whole and pieces.pieces:
        return
    total = len(pieces.pieces) + pieces.short
    longest = max((b - a for a, b in edges), default=0)
    if longest < FEWEST_SAMPLES:
        raise InputRefused(
            where,
            f"no level holds for more than {longest} sample{'s' * (longest != 1)}: it is a ramp, or"
            " each row is a mean already",
            'means belong in the schedule (reader = "means"); a ramp is cut by windows, or by a'
            " larger hold under [segments]",
        )
    enough, less = cuts.longest_shortest(edges, settle), settle
    while enough < FEWEST_SAMPLES and less:
        less //= 2
        enough = cuts.longest_shortest(edges, less)
    other = f' and settle = "{less / rate:.3g} s"' if less < settle else ""
    raise InputRefused(
        where,
        f"{pieces.short} of {total} pieces are too short, with"
        f" {100 * (1 - kept / max(whole, 1)):.0f} % of the samples",
        f'shortest = "{int(1000 * enough / rate) / 1000:g} s"{other} under [segments] would keep'
        " half of them",
    )


def sloping(cut: Segments, pieces: cuts.Cuts, values: FloatArray) -> bool:
    """Whether most pieces move through most of `hold` from end to end: a ramp, not levels."""
    if not cut.hold or not pieces.pieces:
        return False
    moved = []
    for piece in pieces.pieces:
        part = np.array_split(values[piece.first : piece.end], 4)
        moved.append(abs(float(part[-1].mean() - part[0].mean())) > SLOPING * cut.hold)
    return float(np.mean(moved)) > MOST_SLOPING
