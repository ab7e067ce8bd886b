"""A record of many trials cut into pieces.

The cuts are at the steps of a column or of the force, or into windows. Each piece has its samples
and the means of other columns.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nearlift.campaign.manifest import Campaign
from nearlift.campaign.segments import FEWEST_SAMPLES, Segments
from nearlift.declare import BoolArray, FloatArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import guarded
from nearlift.readers.base import (
    Reader,
    Record,
    RecordsDialect,
    names_of,
    pick,
)
from nearlift.readers.files import Piece, packing
from nearlift.readers.text import TEXT, words_of
from nearlift.reduction import cuts
from nearlift.reduction.mean_noise import spectral_density_at_zero
from nearlift.schedule import BESIDE, brought, dimension_of

#: Share of the cut samples that kept pieces and their settling must be.
MIN_YIELD = 0.25
#: Part of `hold` that a level may move through from end to end: most pieces of a ramp exceed it.
SLOPING = 0.6
REPEATED = (
    "samples that repeat the one before, stamp and force, were counted once: the cell is slower"
    " than the rows"
)


#: Samples of a piece that has none.
NO_SAMPLES: FloatArray = np.empty(0)


@dataclass(frozen=True, slots=True, kw_only=True)
class CutPiece:
    """One piece of a record: a trial.

    Attributes
    ----------
    number : int
        Number from 1 in the record's order; 0 for a record without pieces.
    since_s : float
        Time from the record's first sample to the piece's.
    brought : mapping of str to float
        Values in SI of the schedule's columns that the record holds.
    covariates : mapping of str to (float, float)
        Mean and scatter of each further column.
    force_N : (n,) float array
        Settled samples, tare not removed.
    time_s : (n,) float array or None
        Their clock, where there is one that can show gaps.
    tare_N : (m,) float array
        Samples of the piece's zero.
    """

    number: int = 0
    since_s: float = 0.0
    brought: Mapping[str, float] = field(default_factory=dict)
    covariates: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    force_N: FloatArray = field(default_factory=lambda: NO_SAMPLES)
    time_s: FloatArray | None = None
    tare_N: FloatArray = field(default_factory=lambda: NO_SAMPLES)

    @property
    def without_samples(self) -> CutPiece:
        """The piece without its samples."""
        return replace(self, force_N=NO_SAMPLES, time_s=None, tare_N=NO_SAMPLES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Segmented:
    """A record cut into pieces. `record` is the whole of it, and `cuts` are its cuts, in samples of
    the whole. `at_rest` counts the pieces that have no throttle, or are the tare.
    """

    record: Record
    cuts: cuts.Cuts = field(default_factory=cuts.Cuts)
    pieces: tuple[CutPiece, ...] = ()
    at_rest: int = 0


def cutting(reader: Reader) -> Reader:
    """The reader of all channels of a record; `ManifestError` where there is none, so that nothing
    is known of a record's other columns.
    """
    if reader.name == "csv":
        return TEXT
    if reader.contents is None or reader.name == "parquet":
        raise ManifestError(
            "segments", f"reader = {reader.name!r} does not cut records", 'take "text" or "csv"'
        )
    return reader


def read(campaign: Campaign, root: Path, reader: Reader, record: str, path: Path) -> Segmented:
    """The pieces of one record; `InputRefused` where its file cannot be read as the manifest says,
    or does not fall into pieces.
    """
    piece = Piece(trials=(record,), paths=(path,))
    (whole,) = cutting(reader).read_piece(campaign, root, piece, whole=True)
    if whole.refusal is not None:
        raise whole.refusal
    return cut(campaign, root, whole)


def cut(campaign: Campaign, root: Path, whole: Record) -> Segmented:
    """The pieces of a record that was read with all channels of its file; raises as `read`."""
    if whole.contents is None or not len(whole.force_N):
        return Segmented(record=whole)
    said, rate = campaign.segments, campaign.load_cell.sample_rate
    assert said is not None
    assert rate is not None
    channels, path = whole.contents.channels, root / whole.source
    head = min(round(campaign.tare_s * rate), len(whole.force_N))
    values, edges = _edges(said, whole, path, campaign.records.dialect, head, rate)
    settle, shortest, length = (
        round(t * rate) for t in (said.settle, said.shortest, said.length or 0.0)
    )
    spans = cuts.settled(edges, settle, shortest, length or None)
    _require_yield(spans, edges, settle, rate, str(path))
    bring = {
        name: (
            pick(
                channels,
                column.column,
                "segments.by" if key == "segments" else f"{key}.column",
                str(path),
            ),
            column.linear(dimension_of(name), key),
        )
        for name, (column, key) in brought(said).items()
    }
    zeros: list[cuts.Span] = []
    if campaign.load_cell.tare == "level 0":
        level = {p: _middle("throttle", values[p.start : p.end]) for p in spans.pieces}
        lowest = min(level.values(), default=np.nan)
        zeros = [p for p in spans.pieces if level[p] <= lowest + said.hold]
    names = names_of(campaign, whole.trial)
    known = {id(pick(channels, n, "", "")) for n in names} | {id(c) for c, _ in bring.values()}
    further = [c for c in channels if id(c) not in known and len(c.values) == len(whole.force_N)]
    time_s, kept = _new_samples(whole)
    trials: list[CutPiece] = []
    for piece in spans.pieces:
        span = slice(piece.start, piece.end)
        level_of = {
            name: factor * _middle(name, c.values[span]) + offset
            for name, (c, (factor, offset)) in bring.items()
        }
        # a comparison with no number is false
        running = level_of.get("throttle", 1.0) > 0 <= level_of.get("distance", 0.0)
        if piece in zeros or not running:
            continue
        for name in bring.keys() & set(BESIDE):
            channel, (factor, _) = bring[name]
            mean, u = _less_zero(
                channel.values[span], _zero(channel.values, zeros, piece, head), rate
            )
            level_of |= {name: factor * mean, f"u_{name}": abs(factor) * u}
        trials.append(
            CutPiece(
                number=piece.number,
                since_s=piece.start / rate,
                brought=level_of,
                covariates={c.name: _mean_and_scatter(c.values[span]) for c in further},
                force_N=whole.force_N[span][kept[span]],
                time_s=None if time_s is None else time_s[span],
                tare_N=_zero(whole.force_N, zeros, piece, head),
            )
        )
    notes = [*whole.notes, *[REPEATED] * (not kept.all())]
    if _slope(values, said.hold, spans):
        notes.append(
            f"the level {said.by!r} moves through most of hold = {said.hold:g} within most"
            " pieces: a ramp has no steps, and hold makes some of it"
        )
    return Segmented(
        record=replace(whole, notes=tuple(notes)),
        cuts=spans,
        pieces=tuple(trials),
        at_rest=len(spans.pieces) - len(trials),
    )


# ---- where it is cut


def _edges(
    said: Segments, whole: Record, path: Path, dialect: RecordsDialect, head: int, rate_Hz: float
) -> tuple[FloatArray, list[cuts.Cut]]:
    """The values that step, and the edges behind the head, by the manifest's way."""
    values, n = whole.force_N, len(whole.force_N)
    if said.by == "windows":
        return values, [(head, n)]
    if said.column is None:
        step = said.step_N()
        _require_coarse(values[head:], step, str(path))
        smallest = max(round((said.settle + said.shortest) * rate_Hz), 1)
        changes = cuts.by_change(values[head:], step, smallest)
        return values, [(head + a, head + b) for a, b in changes]
    only = said.only
    if isinstance(only, str):
        words = (
            guarded.run(words_of, path, dialect, said.by)
            if packing(path)
            else words_of(path, dialect, said.by)
        )[:n]
        if only not in words:
            listed = ", ".join(map(repr, sorted(set(words))[:8]))
            what = f"has no {only!r} in column {said.by!r}"
            raise InputRefused(str(path), what, f"it has {listed}")
        values, only = np.array([float(word == only) for word in words]), 1.0
    else:
        assert whole.contents is not None
        values = pick(whole.contents.channels, said.by, "segments.by", str(path)).values
        if len(values) != n:
            what = f"has {n} samples of force and {len(values)} of {said.by!r}"
            remedy = "a record is cut by a column of the same clock"
            raise InputRefused(str(path), what, remedy)
    edges = [(head + a, head + b) for a, b in cuts.by_level(values[head:], said.hold)]
    return values, [(a, b) for a, b in edges if only is None or values[a] == only]


def _require_coarse(values: FloatArray, step: float, where: str) -> None:
    """Refuse a step below three codes of a coarse converter: every code would be a plateau."""
    apart = np.abs(np.diff(values[np.isfinite(values)]))
    moved = apart[apart > 0]
    grain = float(moved.min()) if len(moved) else 0.0
    if len(moved) < 0.5 * len(apart) and step < 3 * grain * (1 - 1e-9):
        what = f"a step of {step:.3g} is less than three of the converter's own ({grain:.3g})"
        raise InputRefused(where, what, "take a larger step under [segments]")


def _require_yield(
    spans: cuts.Cuts, edges: Sequence[cuts.Cut], settle: int, rate_Hz: float, where: str
) -> None:
    """Refuse a record of which hardly anything is kept, with what would keep half of it."""
    whole = sum(b - a for a, b in edges)
    kept = sum(p.end - p.first for p in spans.pieces)
    if kept >= MIN_YIELD * whole and spans.pieces:
        return
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
    other = f' and settle = "{less / rate_Hz:.3g} s"' if less < settle else ""
    raise InputRefused(
        where,
        f"{spans.short} of {len(spans.pieces) + spans.short} pieces are too short, with"
        f" {100 * (1 - kept / max(whole, 1)):.0f} % of the samples",
        f'shortest = "{int(1000 * enough / rate_Hz) / 1000:g} s"{other} under [segments] would'
        " keep half of them",
    )


# ---- the content of a piece


def _slope(values: FloatArray, hold: float, spans: cuts.Cuts) -> bool:
    """Whether most pieces move through most of `hold` from end to end: a ramp, not levels."""
    parts = [np.array_split(values[p.first : p.end], 4) for p in spans.pieces]
    moved = [abs(float(part[-1].mean() - part[0].mean())) > SLOPING * hold for part in parts]
    return bool(hold) and 2 * sum(moved) > len(moved)


def _zero(
    values: FloatArray, zeros: Sequence[cuts.Span], piece: cuts.Span, head: int
) -> FloatArray:
    """The samples of a piece's zero: the record's head, or the nearest pieces at rest."""
    if not zeros:
        return values[:head]
    before = [p for p in zeros if p.end <= piece.start][-1:]
    behind = [p for p in zeros if p.start >= piece.end][:1]
    return np.concatenate([values[p.start : p.end] for p in (*before, *behind)])


def _less_zero(values: FloatArray, zero: FloatArray, rate_Hz: float) -> tuple[float, float]:
    """Mean less that of the zero, and its standard error, in which slow noise is counted."""
    total, variance = 0.0, 0.0
    for sign, part in ((1.0, values), (-1.0, zero)):
        known = part[np.isfinite(part)]
        if len(known):
            density, run = spectral_density_at_zero(known, rate_Hz, tone=False)
            total += sign * run.mean
            variance += density / run.n
    return (total, math.sqrt(variance)) if np.isfinite(values).any() else (math.nan, math.nan)


def _middle(name: str, values: FloatArray) -> float:
    """The level of a piece's samples: the median of a command, one of its values, else the mean."""
    known = values[np.isfinite(values)]
    if not known.size:
        return math.nan
    if name in ("throttle", "distance", "reached"):
        return float(np.sort(known)[known.size // 2])
    return float(known.mean())


def _new_samples(whole: Record) -> tuple[FloatArray | None, BoolArray]:
    """The clock if it can show gaps, and a mask of samples that are no repeat of the one before."""
    kept = np.ones(len(whole.force_N), dtype=bool)
    if whole.time_s is None:
        return None, kept
    kept[1:] = (np.diff(whole.time_s) != 0) | (np.diff(whole.force_N) != 0)
    # what is left of a slower clock has no steady step
    return (whole.time_s if kept.all() else None), kept


def _mean_and_scatter(values: FloatArray) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    return (
        float(known.mean()) if len(known) else math.nan,
        float(known.std(ddof=1)) if len(known) > 1 else math.nan,
    )
