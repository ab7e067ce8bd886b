"""A record of many trials cut into pieces, each with its samples and what other columns say."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nearlift.campaign.manifest import Campaign
from nearlift.campaign.segments import Segments
from nearlift.declare import FloatArray, IntArray
from nearlift.errors import ManifestError
from nearlift.readers import guarded
from nearlift.readers.channel import Channel, Malformed, pick
from nearlift.readers.edges import Opened, edges_of, marks_of, sloping, worth_it
from nearlift.readers.files import source_of
from nearlift.readers.per_file import Format, record_of
from nearlift.readers.seam import ChannelSpec, Reader, Record
from nearlift.reduction import cuts
from nearlift.reduction.mean_noise import spectral_density_at_zero
from nearlift.schedule import BESIDE, brought, dimension_of


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
        """What the pieces bring."""
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


def format_of(reader: Reader) -> Format:
    """What turns one file of a reader into all its channels; `ManifestError` where nothing does, so
    that nothing is known of a record's other columns.
    """
    from nearlift.readers.text import TEXT

    if reader.format is None and reader.name != "csv":
        raise ManifestError(
            "segments", f"reader = {reader.name!r} does not cut records", 'take "text" or "csv"'
        )
    return reader.format or TEXT


def read(campaign: Campaign, root: Path, reader: Reader, record: str, path: Path) -> Segmented:
    """The pieces of one record; `InputRefused` where its file cannot be read as the manifest says,
    or does not fall into pieces.
    """
    form, source = format_of(reader), source_of(root, path)

    def without(fault: str, *codes: str) -> Segmented:
        return Segmented(record=Record(trial=record, source=source, codes=codes, fault=fault))

    if path.stat().st_size == 0:
        return without("", "EMPTY")
    spec = ChannelSpec.from_manifest(campaign)
    dialect = spec.dialect
    marks: list[tuple[int, str]] = []
    assert campaign.segments is not None
    try:
        if campaign.segments.begin is not None:
            marks, dialect = marks_of(form, path, campaign)
        contents = guarded.contents(form, path, dialect, None)
    except Malformed as fault:
        return without(f"{source}: {fault}", "MALFORMED")
    if not contents.channels:
        return without("", *contents.codes)
    whole = record_of(contents, spec, record, str(path), source)
    if not len(whole.force_N):
        return Segmented(record=whole)
    opened = Opened(path=path, contents=contents, record=whole, dialect=dialect, marks=marks)
    return _cut(campaign, opened, spec)


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
    worth_it(pieces, edges, samples[0], str(path), rate)
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
    known = [pick(contents.channels, n, "", "") for n in filter(None, spec.of_trial(whole.trial))]
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
    """What a piece's samples say: the median of a command, one of its values, else the mean."""
    known = np.asarray(values, dtype=float)
    known = known[np.isfinite(known)]
    if not known.size:
        return float("nan")
    if name in ("throttle", "distance", "reached"):
        return float(np.sort(known, axis=None)[known.size // 2])
    return float(known.mean())


def _new_samples(whole: Record) -> tuple[FloatArray | None, np.ndarray]:
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
