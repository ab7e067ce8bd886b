"""A record of many trials cut into pieces: at the steps of a column or of the force, at lines of
text, or into windows; each piece with its samples and the means of other columns.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nearlift.campaign.manifest import Campaign
from nearlift.campaign.segments import FEWEST_SAMPLES, LEVEL, Segments
from nearlift.declare import BoolArray, FloatArray, IntArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import guarded
from nearlift.readers.base import (
    Channel,
    ChannelSpec,
    Contents,
    Reader,
    Record,
    RecordsDialect,
    pick,
)
from nearlift.readers.files import is_packed, source_of
from nearlift.readers.guarded import Malformed
from nearlift.readers.table import matches
from nearlift.readers.text import TEXT, words_of
from nearlift.reduction import cuts
from nearlift.reduction.mean_noise import spectral_density_at_zero
from nearlift.schedule import BESIDE, brought, dimension_of

#: Share of the cut samples that kept pieces and their settling must be.
MIN_YIELD = 0.25
#: A marker's level.
NUMBER = re.compile(r"[-+]?\d+(?:[.,]\d+)?")
#: Part of `hold` that kept pieces may move through from end to end, and the share of them that may:
#: a ramp goes through all of it.
SLOPING, MOST_SLOPING = 0.6, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Pieces:
    """The pieces of a record, each a trial; every array has one entry per piece.

    A piece has its `number`, from 1 in the record's order, and begins `since_s` behind the record's
    first sample. What is `brought` is in SI, by the schedule's columns; `covariates` and `scatter`
    are mean and scatter of the record's further columns; one without scatter has none.
    """

    number: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    since_s: FloatArray = field(default_factory=lambda: np.empty(0))
    brought: Mapping[str, FloatArray] = field(default_factory=dict)
    covariates: Mapping[str, FloatArray] = field(default_factory=dict)
    scatter: Mapping[str, FloatArray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.number)


@dataclass(frozen=True, slots=True, kw_only=True)
class CutPiece:
    """A piece, as in `Pieces` (a covariate is its mean and its scatter), with its samples: the
    settled `force_N` (n,), tare not removed; `time_s` (n,), their clock, where there is one that
    can tell gaps; and `tare_N` (m,), the samples of its zero.
    """

    number: int
    since_s: float
    brought: Mapping[str, float]
    covariates: Mapping[str, tuple[float, float]]
    force_N: FloatArray
    time_s: FloatArray | None
    tare_N: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Segmented:
    """A record cut into pieces. `record` is the whole of it, `cuts` where it was cut, in samples of
    the whole, `at_rest` how many pieces have no throttle, or are the tare.
    """

    record: Record
    cuts: cuts.Cuts = field(default_factory=cuts.Cuts)
    pieces: tuple[CutPiece, ...] = ()
    at_rest: int = 0

    @property
    def without_samples(self) -> Pieces:
        """The pieces without their samples."""
        pieces = self.pieces
        bring = pieces[0].brought if pieces else ()
        further = pieces[0].covariates if pieces else ()
        beside = {n: np.array([p.covariates[n] for p in pieces]) for n in further}
        return Pieces(
            number=np.array([p.number for p in pieces], dtype=np.int64),
            since_s=np.array([p.since_s for p in pieces]),
            brought={n: np.array([p.brought[n] for p in pieces]) for n in bring},
            covariates={n: values[:, 0] for n, values in beside.items()},
            scatter={n: values[:, 1] for n, values in beside.items()},
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Opened:
    """A record that was read: all channels of its file, the force among them as `record`, and the
    dialect that it is in.
    """

    path: Path
    contents: Contents
    record: Record
    dialect: RecordsDialect


def cutting(reader: Reader) -> Reader:
    """The reader of all channels of a record; `ManifestError` where there is none, so that nothing
    is known of a record's other columns.
    """
    if reader.name == "csv":
        return TEXT
    if not reader.series or reader.name == "parquet":
        raise ManifestError(
            "segments", f"reader = {reader.name!r} does not cut records", 'take "text" or "csv"'
        )
    return reader


def read(campaign: Campaign, root: Path, reader: Reader, record: str, path: Path) -> Segmented:
    """The pieces of one record; `InputRefused` where its file cannot be read as the manifest says,
    or does not fall into pieces.
    """
    reader, source = cutting(reader), source_of(root, path)

    def without(fault: str, *codes: str) -> Segmented:
        return Segmented(record=Record(trial=record, source=source, codes=codes, fault=fault))

    if path.stat().st_size == 0:
        return without("", "EMPTY")
    spec = ChannelSpec.from_manifest(campaign)
    dialect = _with_markers(campaign, reader)
    try:
        contents = reader.open(path, dialect)
    except Malformed as fault:
        return without(f"{source}: {fault}", "MALFORMED")
    if not contents.channels:
        return without("", *contents.codes)
    whole = spec.record(contents, record, str(path), source)
    if not len(whole.force_N):
        return Segmented(record=whole)
    return _cut(campaign, Opened(path=path, contents=contents, record=whole, dialect=dialect), spec)


def _with_markers(campaign: Campaign, reader: Reader) -> RecordsDialect:
    """The dialect in which the lines that begin or end a piece are no samples."""
    cut, said = campaign.segments, campaign.records.dialect
    assert cut is not None
    if cut.begin is None:
        return said
    if "ignore" not in reader.options:
        raise ManifestError(
            "segments.by",
            f'"markers" are lines of a text, and reader = {reader.name!r} has none',
            'take reader = "text", or by = a column',
        )
    given = said.get("ignore", ())
    return {**said, "ignore": [*(given if isinstance(given, list) else ()), *_markers(cut)]}


def _markers(cut: Segments) -> list[str]:
    """The forms of the lines that begin or end a piece."""
    return [line.replace(LEVEL, "*") for line in (cut.begin, cut.end) if line is not None]


def _cut(campaign: Campaign, opened: Opened, spec: ChannelSpec) -> Segmented:
    """The pieces of a record that was read."""
    cut, cell = campaign.segments, campaign.load_cell
    contents, whole, path = opened.contents, opened.record, opened.path
    assert cut is not None
    assert cell.sample_rate is not None
    rate, n = cell.sample_rate, len(whole.force_N)
    head = min(round(campaign.tare_s * rate), n)
    values, edges, levels = edges_of(cut, opened, head, rate)
    samples = [round(t * rate) for t in (cut.settle, cut.shortest, cut.length or 0.0)]
    pieces = cuts.settled(edges, samples[0], samples[1], samples[2] or None)
    require_yield(pieces, edges, samples[0], str(path), rate)
    bring: dict[str, tuple[Channel | None, tuple[float, float]]] = {}
    for name, (column, key) in brought(cut).items():
        by_mark = key == "segments" and cut.column is None
        asked = "segments.by" if key == "segments" else f"{key}.column"
        channel = None if by_mark else pick(contents.channels, column.column, asked, str(path))
        bring[name] = channel, column.linear(dimension_of(name), key)
    time_s, kept = _new_samples(whole)
    at_level = (
        _lowest(pieces, values, cut.hold) if cell.tare == "level 0" and values is not None else ()
    )
    known = [pick(contents.channels, n, "", "") for n in spec.names(whole.trial)]
    known += [c for c, _ in bring.values() if c is not None]
    further = _further(cut, opened, known)
    trials: list[CutPiece] = []
    for piece in pieces.pieces:
        span = slice(piece.start, piece.end)
        place = next(k for k, (a, b) in enumerate(edges) if a <= piece.start < b)
        level = {
            name: factor * _level(name, levels[place] if c is None else c.values[span]) + offset
            for name, (c, (factor, offset)) in bring.items()
        }
        # a comparison with no number is false
        if piece in at_level or not level.get("throttle", 1.0) > 0.0 <= level.get("distance", 0.0):
            continue
        for name in bring.keys() & set(BESIDE):
            channel, (factor, _) = bring[name]
            assert channel is not None
            zero = _tare(channel.values, head, at_level, piece)
            mean, u = _beside(channel.values[span], zero, rate)
            level |= {name: factor * mean, f"u_{name}": abs(factor) * u}
        mask = kept[span]
        trials.append(
            CutPiece(
                number=piece.number,
                force_N=whole.force_N[span][mask],
                time_s=None if time_s is None else time_s[span],
                tare_N=_tare(whole.force_N, head, at_level, piece),
                since_s=piece.start / rate,
                brought=level,
                covariates=_means(further, span),
            )
        )
    notes = list(whole.notes)
    if not kept.all():
        notes.append(
            "samples that repeat the one before, stamp and force, were counted once: the cell is"
            " slower than the rows"
        )
    if cut.column is not None and values is not None and sloping(cut, pieces, values):
        notes.append(
            f"the level {cut.by!r} moves through most of hold = {cut.hold:g} within most pieces: a"
            " ramp has no steps, and hold makes some of it"
        )
    return Segmented(
        record=replace(whole, notes=tuple(notes)),
        cuts=pieces,
        pieces=tuple(trials),
        at_rest=len(pieces.pieces) - len(trials),
    )


def _beside(values: FloatArray, zero: FloatArray, rate_Hz: float) -> tuple[float, float]:
    """Mean less that of the zero, and its standard error, in which what lasts is counted."""
    total, variance = 0.0, 0.0
    for sign, part in ((1.0, values), (-1.0, zero)):
        known = part[np.isfinite(part)]
        if len(known):
            density, run = spectral_density_at_zero(known, rate_Hz, tone=False)
            total += sign * run.mean
            variance += density / run.n
    return (total, math.sqrt(variance)) if np.isfinite(values).any() else (math.nan, math.nan)


def _level(name: str, values: FloatArray | float) -> float:
    """The level of a piece's samples: the median of a command, one of its values, else the mean."""
    known = np.asarray(values, dtype=float)
    known = known[np.isfinite(known)]
    if not known.size:
        return float("nan")
    if name in ("throttle", "distance", "reached"):
        return float(np.sort(known, axis=None)[known.size // 2])
    return float(known.mean())


def _new_samples(whole: Record) -> tuple[FloatArray | None, BoolArray]:
    """The clock if it can tell gaps, and a mask of samples that are no repeat of the one before."""
    kept = np.ones(len(whole.force_N), dtype=bool)
    if whole.time_s is None:
        return None, kept
    kept[1:] = (np.diff(whole.time_s) != 0) | (np.diff(whole.force_N) != 0)
    # what is left of a slower clock has no steady step
    return (whole.time_s if kept.all() else None), kept


def _lowest(pieces: cuts.Cuts, values: FloatArray, hold: float) -> tuple[cuts.Span, ...]:
    """The pieces at the lowest level there is, within `hold`."""
    level = {p: _level("throttle", values[p.start : p.end]) for p in pieces.pieces}
    lowest = min(level.values(), default=np.nan)
    return tuple(p for p in pieces.pieces if level[p] <= lowest + hold)


def _tare(
    force_N: FloatArray, head: int, at_level: Sequence[cuts.Span], piece: cuts.Span
) -> FloatArray:
    """The samples of a piece's zero: the record's head, or the nearest pieces at rest around it."""
    if not at_level:
        return force_N[:head]
    before = [p for p in at_level if p.end <= piece.start][-1:]
    behind = [p for p in at_level if p.start >= piece.end][:1]
    return np.concatenate([force_N[p.start : p.end] for p in (*before, *behind)])


def _further(cut: Segments, opened: Opened, known: Sequence[Channel]) -> list[Channel]:
    """The columns whose means become covariates: as many samples as the force, and not `known`."""
    channels, whole = opened.contents.channels, opened.record
    if cut.covariates is not None:
        key = "segments.covariates"
        return [pick(channels, name, key, whole.source) for name in cut.covariates]
    names = {id(c) for c in known}
    return [c for c in channels if id(c) not in names and len(c.values) == len(whole.force_N)]


def _means(channels: Sequence[Channel], span: slice) -> dict[str, tuple[float, float]]:
    """Mean and scatter of each column over a piece."""
    means: dict[str, tuple[float, float]] = {}
    for c in channels:
        values = c.values[span]
        values = values[np.isfinite(values)]
        means[c.name] = (
            float(values.mean()) if len(values) else np.nan,
            float(values.std(ddof=1)) if len(values) > 1 else np.nan,
        )
    return means


# ---- where it is cut


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
        markers = _markers(cut)
        marks = [mark for mark in opened.contents.marks if _is_like(mark[1], markers)]
        edges, levels = _between(cut, marks, head, n)
        if not edges:
            raise InputRefused(
                where,
                f"has no line {cut.begin!r} with samples behind it",
                "correct begin under [segments]; it is a whole line, {level} is a number",
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
    _require_coarse_step(values[head:], step, where)
    smallest = max(round((cut.settle + cut.shortest) * rate), 1)
    edges = [(head + a, head + b) for a, b in cuts.by_change(values[head:], step, smallest)]
    return values, edges, [np.nan] * len(edges)


def _stepping(cut: Segments, opened: Opened) -> tuple[FloatArray, float | None]:
    """The column that steps, a text's words as numbers, and the one value to keep, if one is."""
    n, path = len(opened.record.force_N), opened.path
    if isinstance(cut.only, str):
        arguments = path, opened.dialect, cut.by
        words = (guarded.run(words_of, *arguments) if is_packed(path) else words_of(*arguments))[:n]
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


def _require_coarse_step(values: FloatArray, step: float, where: str) -> None:
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


def _is_like(line: str, forms: Sequence[str]) -> bool:
    return any(matches(form, line) for form in forms)


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


def require_yield(
    pieces: cuts.Cuts, edges: Sequence[cuts.Cut], settle: int, where: str, rate: float
) -> None:
    """Refuse a record of which hardly anything is kept, with what would keep half of it."""
    whole = sum(b - a for a, b in edges)
    kept = sum(p.end - p.first for p in pieces.pieces)
    if kept >= MIN_YIELD * whole and pieces.pieces:
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
