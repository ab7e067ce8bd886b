"""A record of many trials cut into pieces, and the schedule of all pieces.

The cuts are at the steps of a column or of the force, or into windows. Each piece has its samples
and the means of other columns. A row of trials.csv is then a record. Its pieces share the row's
boundary, distance and session, and so the visit of the traverse. Columns that the pieces bring,
such as throttle, are added to the row's, and the result is checked as any schedule.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nearlift import schedule as schedules
from nearlift import units
from nearlift.campaign.manifest import Campaign
from nearlift.campaign.rig import FEWEST_SAMPLES, Segments
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers.base import Reader, Record, names_of, pick
from nearlift.readers.files import Piece
from nearlift.readers.text import TEXT, words_of
from nearlift.reduction import cuts
from nearlift.reduction.mean_noise import part_of

#: Share of the cut samples that kept pieces and their settling must be.
MIN_YIELD = 0.25
REPEATED = (
    "samples that repeat the one before, stamp and force, were counted once: the cell is slower"
    " than the rows"
)
#: Samples of a piece that has none.
NO_SAMPLES: FloatArray = np.empty(0)


@dataclass(frozen=True, slots=True, kw_only=True)
class CutPiece:
    """One piece of a record: a trial, or (number 0) a record without pieces.

    `number` is that in the record's order, from 1. `since_s` is the time from the record's first
    sample to the piece's. `brought` are values in SI of the schedule's columns that the record
    holds. `covariates` are mean and scatter of each further column. `force_N` (n,) are the settled
    samples, tare not removed, `time_s` (n,) their clock, where one can show gaps, and `tare_N` (m,)
    the samples of the piece's zero.
    """

    number: int = 0
    since_s: float = 0.0
    brought: Mapping[str, float] = field(default_factory=dict)
    covariates: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    force_N: FloatArray = field(default_factory=lambda: NO_SAMPLES)
    time_s: FloatArray | None = None
    tare_N: FloatArray = field(default_factory=lambda: NO_SAMPLES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Segmented:
    """A record, its cuts in samples of the whole, and its pieces; `at_rest` counts those that have
    no throttle, or are the tare.
    """

    record: Record
    cuts: cuts.Cuts = field(default_factory=cuts.Cuts)
    pieces: tuple[CutPiece, ...] = ()
    at_rest: int = 0


def cutting(reader: Reader) -> Reader:
    """The reader of all channels of a record; `ManifestError` where there is none."""
    if reader.name == "csv":
        return TEXT
    if reader.contents is None or reader.name == "parquet":
        what = f"reader = {reader.name!r} does not cut records"
        raise ManifestError("segments", what, 'take "text" or "csv"')
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
    section, rate, n = campaign.segments, campaign.load_cell.sample_rate, len(whole.force_N)
    # by the manifest's own check
    assert section is not None
    assert rate is not None
    channels, where = whole.contents.channels, str(root / whole.source)
    head = min(round(campaign.tare_s * rate), n)
    values, edges = _edges(campaign, section, whole, root / whole.source, head, rate)
    settle, shortest, length = (
        round(t * rate) for t in (section.settle, section.shortest, section.length or 0.0)
    )
    spans = cuts.settled(edges, settle, shortest, length or None)
    _require_yield(spans, edges, settle, rate, where)
    # the schedule's columns in the record, each with factor and offset to SI
    bring = {}
    for name, (column, key) in schedules.columns_from_record(section).items():
        at = "segments.column" if key == "segments" else f"{key}.column"
        channel = pick(channels, column.column, at, where)
        bring[name] = channel, *column.linear(schedules.dimension_of(name), key)
    zeros: list[cuts.Span] = []
    if campaign.load_cell.tare == "level 0":
        level = {p: _middle("throttle", values[p.start : p.end]) for p in spans.pieces}
        lowest = min(level.values(), default=np.nan)
        zeros = [p for p in spans.pieces if level[p] <= lowest + section.tolerance]
    known = {pick(channels, name, "", "").name for name in names_of(campaign, whole.trial)}
    known |= {channel.name for channel, _, _ in bring.values()}
    further = [c for c in channels if c.name not in known and len(c.values) == n]
    time_s, kept, notes = whole.time_s, np.ones(n, dtype=bool), whole.notes
    if time_s is not None:
        kept[1:] = (np.diff(time_s) != 0) | (np.diff(whole.force_N) != 0)
        if not kept.all():
            # what is left of a slower clock has no steady step, and shows no gaps
            time_s, notes = None, (*notes, REPEATED)
    trials: list[CutPiece] = []
    for piece in spans.pieces:
        span = slice(piece.start, piece.end)
        level_of = {
            name: factor * _middle(name, channel.values[span]) + offset
            for name, (channel, factor, offset) in bring.items()
        }
        # a comparison with no number is false
        running = level_of.get("throttle", 1.0) > 0 <= level_of.get("distance", 0.0)
        if piece in zeros or not running:
            continue
        for name in bring.keys() & set(schedules.OUTCOMES):
            channel, factor, _ = bring[name]
            zero = _zero(channel.values, zeros, piece, head)
            mean, u = _less_zero(channel.values[span], zero, rate)
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
    at_rest, record = len(spans.pieces) - len(trials), replace(whole, notes=notes)
    return Segmented(record=record, cuts=spans, pieces=tuple(trials), at_rest=at_rest)


# ---- where it is cut


def _edges(
    campaign: Campaign, section: Segments, whole: Record, path: Path, head: int, rate_Hz: float
) -> tuple[FloatArray, list[cuts.Cut]]:
    """The values that step, and the edges behind the head, by the manifest's way."""
    values, n, only = whole.force_N, len(whole.force_N), section.keep_where
    if section.cut == "windows":
        return values, [(head, n)]
    if section.column is None:
        step = section.step or 0.0
        steps = np.abs(np.diff(values[head:][np.isfinite(values[head:])]))
        grain = float(steps[steps > 0].min(initial=np.inf))
        # of a coarse converter every code would be a plateau
        if np.count_nonzero(steps) < 0.5 * len(steps) and step < 3 * grain * (1 - 1e-9) < np.inf:
            what = f"a step of {step:.3g} is less than three of the converter's own ({grain:.3g})"
            raise InputRefused(str(path), what, "take a larger step under [segments]")
        smallest = max(round((section.settle + section.shortest) * rate_Hz), 1)
        changes = cuts.by_change(values[head:], step, smallest)
        return values, [(head + a, head + b) for a, b in changes]
    if isinstance(only, str):
        words = words_of(path, campaign.records.dialect, section.column)[:n]
        if only not in words:
            listed = ", ".join(map(repr, sorted(set(words))[:8]))
            what = f"has no {only!r} in column {section.column!r}"
            raise InputRefused(str(path), what, f"it has {listed}")
        values, only = np.array([float(word == only) for word in words]), 1.0
    else:
        assert whole.contents is not None
        values = pick(whole.contents.channels, section.column, "segments.column", str(path)).values
        if len(values) != n:
            what = f"has {n} samples of force and {len(values)} of {section.column!r}"
            remedy = "a record is cut by a column of the same clock"
            raise InputRefused(str(path), what, remedy)
    edges = [(head + a, head + b) for a, b in cuts.by_level(values[head:], section.tolerance)]
    return values, [(a, b) for a, b in edges if only is None or values[a] == only]


def _require_yield(
    spans: cuts.Cuts, edges: Sequence[cuts.Cut], settle: int, rate_Hz: float, where: str
) -> None:
    """Refuse a record of which hardly anything is kept, with what would keep half of it."""
    lengths = [b - a for a, b in edges]
    kept, longest = sum(p.end - p.first for p in spans.pieces), max(lengths, default=0)
    if kept >= MIN_YIELD * sum(lengths) and spans.pieces:
        return
    if longest < FEWEST_SAMPLES:
        samples = f"{longest} sample{'s' * (longest != 1)}"
        what = f"no level holds for more than {samples}: it is a ramp, or each row is a mean"
        remedy = 'means belong in the schedule (reader = "means"); a ramp is cut by windows'
        raise InputRefused(where, f"{what} already", f"{remedy}, or by a larger tolerance")
    enough, less = cuts.longest_shortest(edges, settle), settle
    while enough < FEWEST_SAMPLES and less:
        less //= 2
        enough = cuts.longest_shortest(edges, less)
    other = f' and settle = "{less / rate_Hz:.3g} s"' if less < settle else ""
    lost, pieces = 100 * (1 - kept / max(sum(lengths), 1)), len(spans.pieces) + spans.short
    what = f"{spans.short} of {pieces} pieces are too short, with {lost:.0f} % of the samples"
    shortest = f'shortest = "{int(1000 * enough / rate_Hz) / 1000:g} s"{other}'
    raise InputRefused(where, what, f"{shortest} under [segments] would keep half of them")


# ---- the content of a piece


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
        if len(known := part[np.isfinite(part)]):
            _, density, run = part_of(known, rate_Hz, tone=False)
            total += sign * run.mean
            variance += density / run.n
    return (total, math.sqrt(variance)) if np.isfinite(values).any() else (math.nan, math.nan)


def _middle(name: str, values: FloatArray) -> float:
    """The level of a piece's samples: the median of a command, one of its values, else the mean."""
    known = values[np.isfinite(values)]
    if known.size and name in ("throttle", "distance", "reached"):
        return float(np.sort(known)[known.size // 2])
    return float(known.mean()) if known.size else math.nan


def _mean_and_scatter(values: FloatArray) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    scatter = float(known.std(ddof=1)) if len(known) > 1 else math.nan
    return _middle("", known), scatter


# ---- the schedule of all pieces


def schedule_of_trials(
    campaign: Campaign, root: Path, pieces: Mapping[str, Sequence[CutPiece]]
) -> schedules.Schedule:
    """The schedule of the pieces of every record; a record without pieces has one row.

    Covariates include `record`, `piece`, and means and scatter of the records' further columns, NaN
    where a record has none. A name that the schedule has for itself is made the record's. Raises as
    `read_schedule` does.
    """
    section = campaign.segments
    assert section is not None
    read, notes = schedules.read_columns(campaign, root)
    rows, bring = schedules.rename_records(campaign, root, read)
    ids = list(rows["trial"].texts)
    cut = [(i, p) for i, record in enumerate(ids) for p in pieces.get(record) or [CutPiece()]]
    places, trials = [i for i, _ in cut], [piece for _, piece in cut]
    columns = {}
    for name, column in rows.items():
        lines = [column.lines[i] for i in places] if column.lines else ()
        columns[name] = replace(column, texts=[column.texts[i] for i in places], lines=lines)
    trial = columns["trial"]
    records = [ids[i] for i in places]
    names = [f"{r}#{p.number}" if p.number else r for r, p in zip(records, trials, strict=True)]
    columns["trial"] = replace(trial, texts=names)
    # each record may have been set up differently
    columns.setdefault("session", schedules.TextColumn("session", records, trial.file, trial.lines))
    for name in bring:
        values = np.array([piece.brought.get(name, np.nan) for piece in trials])
        if name == section.becomes and section.level and section.tolerance > 0:
            factor, _ = section.level.linear(schedules.dimension_of(name), "segments")
            _join_levels(values, section.tolerance * abs(factor) * (1 + 1e-9))
        texts = ["" if value != value else repr(value) for value in values.tolist()]
        unit = units.SI[dimension] if (dimension := schedules.dimension_of(name)) else ""
        columns[name] = schedules.TextColumn(name, texts, trial.file, trial.lines, unit)
    schedule = schedules.of_columns(campaign, root, columns, notes, bring)
    covariates = dict(schedule.covariates)
    if "start_s" in covariates:
        covariates["start_s"] = covariates["start_s"] + np.array([p.since_s for p in trials])
    covariates[schedules.RECORD_COLUMN] = np.array(records, dtype=object)
    covariates["piece"] = np.array([piece.number for piece in trials])
    taken, nothing = {*covariates, *schedules.RESERVED, *schedules.BY_NAME}, (np.nan, np.nan)
    for name in dict.fromkeys(name for piece in trials for name in piece.covariates):
        mean, scatter = np.array([piece.covariates.get(name, nothing) for piece in trials]).T
        free = name if name not in taken else f"{schedules.RECORD_COLUMN} {name}"
        # a column without a number anywhere is left out
        covariates |= {free: mean} if np.isfinite(mean).any() else {}
        covariates |= {f"sd_{free}": scatter} if np.isfinite(scatter).any() else {}
    return replace(schedule, covariates=covariates)


def _join_levels(values: FloatArray, reach: float) -> None:
    """Make levels within `reach` of each other one level, their median."""
    order = np.argsort(values)[: np.count_nonzero(np.isfinite(values))]
    first = 0
    for k in range(1, len(order) + 1):
        if k == len(order) or values[order[k]] - values[order[first]] > reach:
            values[order[first:k]] = np.median(values[order[first:k]])
            first = k
