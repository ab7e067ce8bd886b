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
from nearlift.campaign.segments import FEWEST_SAMPLES
from nearlift.declare import BoolArray, FloatArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import guarded
from nearlift.readers.base import (
    Channel,
    ChannelSpec,
    Contents,
    Reader,
    Record,
    pick,
)
from nearlift.readers.files import Piece, is_packed
from nearlift.readers.text import TEXT, words_of
from nearlift.reduction import cuts
from nearlift.reduction.mean_noise import spectral_density_at_zero
from nearlift.schedule import BESIDE, brought, dimension_of

#: Share of the cut samples that kept pieces and their settling must be.
MIN_YIELD = 0.25
#: Part of `hold` that kept pieces may move through from end to end, and the share of them that may:
#: a ramp goes through all of it.
SLOPING, MOST_SLOPING = 0.6, 0.5
REPEATED = (
    "samples that repeat the one before, stamp and force, were counted once: the cell is slower"
    " than the rows"
)


def _no_samples() -> FloatArray:
    return np.empty(0)


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
    force_N: FloatArray = field(default_factory=_no_samples)
    time_s: FloatArray | None = None
    tare_N: FloatArray = field(default_factory=_no_samples)

    @property
    def without_samples(self) -> CutPiece:
        """The piece without its samples."""
        return replace(self, force_N=_no_samples(), time_s=None, tare_N=_no_samples())


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
    return _Cutter(campaign, root / whole.source, whole.contents, whole).segmented()


class _Cutter:
    """Cuts of one record that was read, `whole`, all channels of its file as `contents`.

    Edges are (first sample, one past the last); `values` are those that step.
    """

    def __init__(
        self,
        campaign: Campaign,
        path: Path,
        contents: Contents,
        whole: Record,
    ) -> None:
        cut, rate = campaign.segments, campaign.load_cell.sample_rate
        assert cut is not None
        assert rate is not None
        self.cut, self.rate, self.n = cut, rate, len(whole.force_N)
        self.path, self.where, self.dialect = path, str(path), campaign.records.dialect
        self.names = ChannelSpec.from_manifest(campaign).names(whole.trial)
        self.contents, self.whole = contents, whole
        self.at_level = campaign.load_cell.tare == "level 0"
        self.head = min(round(campaign.tare_s * rate), self.n)
        self.values: FloatArray | None = None
        self.edges = self._edges()

    def segmented(self) -> Segmented:
        """The record cut into pieces."""
        cut, whole, rate = self.cut, self.whole, self.rate
        settle, shortest, length = (
            round(t * rate) for t in (cut.settle, cut.shortest, cut.length or 0.0)
        )
        pieces = cuts.settled(self.edges, settle, shortest, length or None)
        self._require_yield(pieces, settle)
        bring = self._brought()
        time_s, kept = _new_samples(whole)
        zeros = self._zeros(pieces)
        known = [pick(self.contents.channels, n, "", "") for n in self.names]
        further = self._further([*known, *(c for c, _ in bring.values())])
        trials: list[CutPiece] = []
        for piece in pieces.pieces:
            level = {
                name: factor * _middle(name, c.values[piece.start : piece.end]) + offset
                for name, (c, (factor, offset)) in bring.items()
            }
            # a comparison with no number is false
            if piece in zeros or not level.get("throttle", 1.0) > 0 <= level.get("distance", 0.0):
                continue
            span = slice(piece.start, piece.end)
            for name in bring.keys() & set(BESIDE):
                channel, (factor, _) = bring[name]
                zero = self._zero(channel.values, zeros, piece)
                mean, u = _less_zero(channel.values[span], zero, rate)
                level |= {name: factor * mean, f"u_{name}": abs(factor) * u}
            trials.append(
                CutPiece(
                    number=piece.number,
                    since_s=piece.start / rate,
                    brought=level,
                    covariates={c.name: _mean_and_scatter(c.values[span]) for c in further},
                    force_N=whole.force_N[span][kept[span]],
                    time_s=None if time_s is None else time_s[span],
                    tare_N=self._zero(whole.force_N, zeros, piece),
                )
            )
        notes = [*whole.notes, *[REPEATED] * (not kept.all())]
        if cut.column is not None and self._slopes(pieces):
            notes.append(
                f"the level {cut.by!r} moves through most of hold = {cut.hold:g} within most"
                " pieces: a ramp has no steps, and hold makes some of it"
            )
        return Segmented(
            record=replace(whole, notes=tuple(notes)),
            cuts=pieces,
            pieces=tuple(trials),
            at_rest=len(pieces.pieces) - len(trials),
        )

    # ---- where it is cut

    def _edges(self) -> list[cuts.Cut]:
        """Edges behind the head, by the manifest's way; sets `values`."""
        cut, head, n = self.cut, self.head, self.n
        if cut.by == "windows":
            edges = [(head, n)]
        elif cut.column is not None:
            self.values, only = self._stepping()
            edges = [(head + a, head + b) for a, b in cuts.by_level(self.values[head:], cut.hold)]
            if only is not None:
                edges = [(a, b) for a, b in edges if self.values[a] == only]
        else:
            self.values, step = self.whole.force_N, cut.step
            if cut.of is not None:
                self.values = pick(self.contents.channels, cut.of, "segments.of", self.where).values
            step = float(step) if isinstance(step, int | float) and cut.of else cut.step_N()
            self._require_coarse(step)
            smallest = max(round((cut.settle + cut.shortest) * self.rate), 1)
            changes = cuts.by_change(self.values[head:], step, smallest)
            edges = [(head + a, head + b) for a, b in changes]
        return edges

    def _stepping(self) -> tuple[FloatArray, float | None]:
        """The column that steps, a text's words as numbers, and the one value to keep, if any."""
        cut, n, path = self.cut, self.n, self.path
        if isinstance(cut.only, str):
            asked = path, self.dialect, cut.by
            words = (guarded.run(words_of, *asked) if is_packed(path) else words_of(*asked))[:n]
            if cut.only not in words:
                known = ", ".join(map(repr, sorted(set(words))[:8]))
                what = f"has no {cut.only!r} in column {cut.by!r}"
                raise InputRefused(self.where, what, f"it has {known}")
            return np.array([float(word == cut.only) for word in words]), 1.0
        channel = pick(self.contents.channels, cut.by, "segments.by", self.where)
        if len(channel.values) != n:
            raise InputRefused(
                self.where,
                f"has {n} samples of force and {len(channel.values)} of {channel.name!r}",
                "a record is cut by a column of the same clock",
            )
        return channel.values, None if cut.only is None else float(cut.only)

    def _require_coarse(self, step: float) -> None:
        """Refuse a step below three codes of a coarse converter: every code would be a plateau."""
        assert self.values is not None
        values = self.values[self.head :]
        apart = np.abs(np.diff(values[np.isfinite(values)]))
        moved = apart[apart > 0]
        grain = float(moved.min()) if len(moved) else 0.0
        if len(moved) < 0.5 * len(apart) and step < 3 * grain * (1 - 1e-9):
            raise InputRefused(
                self.where,
                f"a step of {step:.3g} is less than three of the converter's own ({grain:.3g})",
                "take a larger step under [segments]",
            )

    def _require_yield(self, pieces: cuts.Cuts, settle: int) -> None:
        """Refuse a record of which hardly anything is kept, with what would keep half of it."""
        edges, rate = self.edges, self.rate
        whole = sum(b - a for a, b in edges)
        kept = sum(p.end - p.first for p in pieces.pieces)
        if kept >= MIN_YIELD * whole and pieces.pieces:
            return
        longest = max((b - a for a, b in edges), default=0)
        if longest < FEWEST_SAMPLES:
            raise InputRefused(
                self.where,
                f"no level holds for more than {longest} sample{'s' * (longest != 1)}: it is a"
                " ramp, or each row is a mean already",
                'means belong in the schedule (reader = "means"); a ramp is cut by windows, or by a'
                " larger hold under [segments]",
            )
        enough, less = cuts.longest_shortest(edges, settle), settle
        while enough < FEWEST_SAMPLES and less:
            less //= 2
            enough = cuts.longest_shortest(edges, less)
        other = f' and settle = "{less / rate:.3g} s"' if less < settle else ""
        raise InputRefused(
            self.where,
            f"{pieces.short} of {len(pieces.pieces) + pieces.short} pieces are too short, with"
            f" {100 * (1 - kept / max(whole, 1)):.0f} % of the samples",
            f'shortest = "{int(1000 * enough / rate) / 1000:g} s"{other} under [segments] would'
            " keep half of them",
        )

    def _slopes(self, pieces: cuts.Cuts) -> bool:
        """Whether most pieces move through most of `hold` from end to end: a ramp, not levels."""
        if not self.cut.hold or not pieces.pieces or self.values is None:
            return False
        moved = []
        for piece in pieces.pieces:
            part = np.array_split(self.values[piece.first : piece.end], 4)
            moved.append(abs(float(part[-1].mean() - part[0].mean())) > SLOPING * self.cut.hold)
        return float(np.mean(moved)) > MOST_SLOPING

    # ---- the content of a piece

    def _brought(self) -> dict[str, tuple[Channel, tuple[float, float]]]:
        """Channel, and factor and offset to SI, by the schedule's columns."""
        bring: dict[str, tuple[Channel, tuple[float, float]]] = {}
        for name, (column, key) in brought(self.cut).items():
            asked = "segments.by" if key == "segments" else f"{key}.column"
            channel = pick(self.contents.channels, column.column, asked, self.where)
            bring[name] = channel, column.linear(dimension_of(name), key)
        return bring

    def _zeros(self, pieces: cuts.Cuts) -> tuple[cuts.Span, ...]:
        """The pieces at the lowest level, within `hold`, where they are the tare."""
        if not self.at_level or self.values is None:
            return ()
        level = {p: _middle("throttle", self.values[p.start : p.end]) for p in pieces.pieces}
        lowest = min(level.values(), default=np.nan)
        return tuple(p for p in pieces.pieces if level[p] <= lowest + self.cut.hold)

    def _zero(self, values: FloatArray, zeros: Sequence[cuts.Span], piece: cuts.Span) -> FloatArray:
        """The samples of a piece's zero: the record's head, or the nearest pieces at rest."""
        if not zeros:
            return values[: self.head]
        before = [p for p in zeros if p.end <= piece.start][-1:]
        behind = [p for p in zeros if p.start >= piece.end][:1]
        return np.concatenate([values[p.start : p.end] for p in (*before, *behind)])

    def _further(self, known: Sequence[Channel]) -> list[Channel]:
        """The columns whose means become covariates: as many samples as the force, not `known`."""
        channels, named = self.contents.channels, self.cut.covariates
        if named is not None:
            return [pick(channels, n, "segments.covariates", self.whole.source) for n in named]
        names = {id(c) for c in known}
        return [c for c in channels if id(c) not in names and len(c.values) == self.n]


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
