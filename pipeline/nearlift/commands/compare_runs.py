"""compare-runs: two runs side by side: the numbers that each quotes first, then the values of the
manifest that differ, last what went in and what made it. Writes nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import click

from nearlift.commands.common import Call, declared, padded
from nearlift.declare import Boundary
from nearlift.errors import UsageError
from nearlift.products import PROVENANCE, RESULTS
from nearlift.results.provenance import ProvenanceLedger
from nearlift.results.quotation import BoundaryResult, Results
from nearlift.results.serial import encode
from nearlift.rounding import fixed, like, plain, plus_minus
from nearlift.run import history, store
from nearlift.run.transaction import Homes

#: What of a run decides its numbers, and how a line of the table calls it.
PARTS = ("inputs", "manifest", "options", "versions", "code", "products", "report")
#: Those whose values are digests.
DIGESTS = ("inputs", "manifest", "code", "products", "report")
#: Names of digests that differ which a line lists.
FEW = 4
#: By name, what A and B have; None where absent.
Differences = Mapping[str, tuple[object, object]]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunAbout:
    """Which run it is; all but the folder empty for one kept in history."""

    folder: str
    campaign: str
    nearlift: str
    platform: str


@dataclass(frozen=True, slots=True, kw_only=True)
class QuotedNumber:
    """A coefficient as a run quotes it, and whether ± says its interval."""

    value: float
    u: float
    lo90: float
    hi90: float
    even: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class MovedCoefficient:
    """A coefficient in both runs, `shift` B less A, `shift_in_u` over u of A: both runs may rest on
    the same data, so their uncertainties do not add.
    """

    boundary: str
    model: str
    name: str
    a: QuotedNumber | None
    b: QuotedNumber | None
    shift: float | None
    shift_in_u: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RunComparison:
    """What differs between two runs, and how many entries of each part are the `same`.

    Digests stand in full; of a kept run, which has none, nothing differs. `manifest_values` are by
    key, None where a manifest was not kept; `trials` the rejected ones that differ.
    """

    schema: str = field(default="nearlift.run_comparison/1", init=False)
    runs: tuple[RunAbout, RunAbout]
    same: Mapping[str, int]
    inputs: Differences
    manifest: Differences
    options: Differences
    versions: Differences
    code: Differences
    products: Differences
    report: Differences
    coefficients: tuple[MovedCoefficient, ...]
    verdicts: Mapping[str, tuple[str | None, str | None]]
    errors: Mapping[str, tuple[Mapping[str, float] | None, Mapping[str, float] | None]]
    manifest_values: Mapping[str, tuple[str | None, str | None]] | None
    trials: Differences


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """One of the two runs: its provenance (empty for one kept in history), what it quotes, and its
    manifest where that was kept.
    """

    folder: Path
    ledger: ProvenanceLedger
    quoted: Mapping[Boundary, BoundaryResult]
    manifest: bytes | None

    @property
    def about(self) -> RunAbout:
        """What the comparison says of it."""
        ledger = self.ledger
        return RunAbout(
            folder=str(self.folder),
            campaign=ledger.campaign,
            nearlift=ledger.nearlift,
            platform=ledger.platform,
        )

    @property
    def rejected(self) -> dict[str, str]:
        """Reason by trial."""
        return {t: r for stage in self.ledger.stages.values() for t, r in stage.rejected}


def run(a: Path, b: Path) -> RunComparison:
    """What differs between two runs: each a folder with provenance.json (``processed/<campaign>``),
    a workspace with one finished campaign, or a kept run (``processed/<campaign>/history/...``).

    Raises
    ------
    UsageError
        A folder holds no run, or several.
    """
    one, two = (_side(path) for path in (a, b))
    # a kept run has no digests, and is not held against one that has
    whole = bool(one.ledger.nearlift and two.ledger.nearlift)
    changed: dict[str, Differences] = {}
    same: dict[str, int] = {}
    for part in PARTS:
        pair = [_part(side.ledger, part) if whole else {} for side in (one, two)]
        changed[part] = _differing(*pair)
        same[part] = len(pair[0].keys() | pair[1].keys()) - len(changed[part])
    numbers = [_numbers(side) for side in (one, two)]
    boundaries = dict.fromkeys([*one.quoted, *two.quoted])
    return RunComparison(
        runs=(one.about, two.about),
        same=same,
        **changed,
        coefficients=tuple(
            _moved(key, numbers[0].get(key), numbers[1].get(key))
            for key in dict.fromkeys([*numbers[0], *numbers[1]])
        ),
        verdicts={
            b: (_verdict(one.quoted.get(b)), _verdict(two.quoted.get(b))) for b in boundaries
        },
        errors={b: (_error(one.quoted.get(b)), _error(two.quoted.get(b))) for b in boundaries},
        manifest_values=(
            None
            if one.manifest is None or two.manifest is None
            else {key: (x, y) for key, x, y in history.changes(one.manifest, two.manifest)}
        ),
        trials=_differing(one.rejected, two.rejected),
    )


def _differing(one: Mapping[str, object], two: Mapping[str, object]) -> Differences:
    return {
        name: (one.get(name), two.get(name))
        for name in dict.fromkeys([*one, *two])
        if one.get(name) != two.get(name)
    }


def _side(path: Path) -> Side:
    if kept := history.read(path.resolve()):
        quoted = store.load(path / RESULTS.file, Results).boundaries if kept.results else {}
        return Side(folder=path, ledger=ProvenanceLedger(), quoted=quoted, manifest=kept.manifest)
    folder = _finished(path)
    file = folder / RESULTS.file
    results = file.read_bytes() if file.is_file() else b""
    # where a run quotes nothing, or an older nearlift kept nothing, nobody knows
    homes = Homes(processed=folder, reports=folder)
    same = (run.manifest for run in history.runs(homes) if results and run.results == results)
    return Side(
        folder=folder,
        ledger=store.load(folder / PROVENANCE.file, ProvenanceLedger),
        quoted=store.load(file, Results).boundaries if results else {},
        manifest=next(same, None),
    )


def _finished(path: Path) -> Path:
    if (path / PROVENANCE.file).is_file():
        return path
    runs = sorted(p.parent for p in path.glob(f"processed/*/{PROVENANCE.file}"))
    if len(runs) == 1:
        return runs[0]
    what = f"holds {len(runs)} finished runs" if runs else "holds no finished run"
    remedy = (
        f"name one of them: {', '.join(str(f) for f in runs)}"
        if runs
        else "name processed/CAMPAIGN, a run in its history, or the folder that was given as --out"
    )
    raise UsageError(str(path), what, remedy)


def _part(ledger: ProvenanceLedger, part: str) -> Mapping[str, object]:
    """Name to value of one part; what stages have in common is listed once."""
    if part == "inputs":
        return {name: entry.sha256 for name, entry in ledger.inputs.items()}
    if part == "options":
        return {"seed": ledger.options.seed}
    if part == "versions":
        return ledger.versions
    stages = ledger.stages
    if part == "manifest":
        return {
            f"[{section}]": digest
            for s in stages.values()
            for section, digest in s.material.manifest.items()
        }
    if part == "code":
        return {name: s.material.code for name, s in stages.items()}
    home = {"products": "processed/", "report": "reports/"}[part]
    return {
        file.removeprefix(home): sha
        for s in stages.values()
        for file, sha in s.outputs.items()
        if file.startswith(home)
    }


Key = tuple[str, str, str]


def _numbers(side: Side) -> dict[Key, QuotedNumber]:
    """The coefficients that a run quotes."""
    return {
        (boundary, result.base_model, name): QuotedNumber(
            value=c.value, u=c.u, lo90=c.lo90, hi90=c.hi90, even=c.even
        )
        for boundary, result in side.quoted.items()
        for name, c in result.quotable.items()
    }


def _moved(key: Key, one: QuotedNumber | None, two: QuotedNumber | None) -> MovedCoefficient:
    shift = in_u = None
    if one and two:
        shift = two.value - one.value
        in_u = shift / one.u if one.u else None
    boundary, model, name = key
    return MovedCoefficient(
        boundary=boundary, model=model, name=name, a=one, b=two, shift=shift, shift_in_u=in_u
    )


def _verdict(result: BoundaryResult | None) -> str | None:
    if result is None:
        return None
    return result.verdict + (f": {', '.join(result.effects)}" if result.effects else "")


def _error(result: BoundaryResult | None) -> dict[str, float] | None:
    if result is None or result.error is None:
        return None
    return {k: getattr(result.error, k) for k in ("before", "after", "noise_floor")}


def table(comparison: RunComparison, digests: bool = False) -> list[str]:
    """The comparison as lines of text; each digest that differs only where they are asked for."""
    lines = [
        f"{letter}  {r.folder}"
        + (f"  (nearlift {r.nearlift}, {r.campaign})" if r.nearlift else "  (kept)")
        for letter, r in zip("AB", comparison.runs, strict=True)
    ]
    rows: list[tuple[str, ...]] = [("", "A", "B", "shift, in u of A"), *_rows(comparison)]
    lines += padded(rows)
    values = comparison.manifest_values
    if values is not None:
        lines.append("manifest:" if values else "manifest: the same values")
        lines += history.lines(tuple((key, old, new) for key, (old, new) in values.items()))
    if comparison.trials:
        lines.append("trials rejected:")
        lines += [
            f"  {trial}: {one or 'accepted'} -> {two or 'accepted'}"
            for trial, (one, two) in comparison.trials.items()
        ]
    if not all(r.nearlift for r in comparison.runs):
        return [*lines, "a kept run has no digests of inputs, code and products"]
    for part in PARTS:
        lines += _of_part(part, getattr(comparison, part), comparison.same[part], digests)
    return lines


def _rows(comparison: RunComparison) -> Iterator[tuple[str, ...]]:
    """Verdict, coefficients and error of each boundary, in A and in B."""
    for boundary, verdicts in comparison.verdicts.items():
        one, two = (verdict or "absent" for verdict in verdicts)
        yield boundary, one, two, "the same" if one == two else ""
        for c in comparison.coefficients:
            if c.boundary == boundary:
                sides = c.a, c.b
                yield f"{boundary} {c.name}", *map(_estimate, sides), _shift(c)
                yield "  90 %", *map(_interval, sides), ""
        errors = comparison.errors[boundary]
        if any(errors):
            for key, what in (("before", "error before"), ("after", "error after")):
                yield f"{boundary} {what}", *(_percent(e, key) for e in errors), ""


def _of_part(part: str, changed: Differences, same: int, digests: bool) -> list[str]:
    what = "sections of the manifest" if part == "manifest" else part
    if not changed:
        return [f"{what}: the same"]
    if part in DIGESTS and not digests:
        names = [*changed][:FEW]
        more = [f"and {len(changed) - FEW} more"] if len(changed) > FEW else []
        which = ", ".join([*names, *more])
        return [f"{what}: {len(changed)} differ, {same} the same: {which} (--digests)"]
    listed = (
        f"  {name}: {_side_of(one)} -> {_side_of(two)}" for name, (one, two) in changed.items()
    )
    return [f"{what}: {len(changed)} differ, {same} the same", *listed]


def _side_of(value: object) -> str:
    """A digest by its first letters, a version in full."""
    if value is None:
        return "absent"
    return value[:12] if isinstance(value, str) and len(value) == 64 else str(value)


def _estimate(e: QuotedNumber | None) -> str:
    return "absent" if e is None else (plus_minus if e.even else like)(e.value, e.u)


def _interval(e: QuotedNumber | None) -> str:
    return "" if e is None else " to ".join(like(end, e.u or 0.0) for end in (e.lo90, e.hi90))


def _percent(error: Mapping[str, float] | None, key: str) -> str:
    return "-" if error is None else f"{plain(100 * error[key], 3)} %"


def _shift(c: MovedCoefficient) -> str:
    if c.shift is None:
        return "-"
    if not c.shift:
        return "the same"
    in_u = f" = {fixed(c.shift_in_u, 2)} u" if c.shift_in_u is not None else ""
    return f"{plain(c.shift, 2)}{in_u}"


@declared("compare-runs")
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@click.option("--digests", is_flag=True, help="List every digest that differs.")
def command(call: Call, a: Path, b: Path, digests: bool) -> None:
    """What differs."""
    comparison = run(a, b)
    call.answer(encode(comparison), "\n".join(table(comparison, digests)))
