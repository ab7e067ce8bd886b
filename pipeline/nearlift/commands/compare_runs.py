"""compare-runs: two finished runs side by side: what went in, what made it, and by how much the
numbers moved. Writes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from nearlift.commands.common import Call, declared
from nearlift.errors import UsageError
from nearlift.products import PROVENANCE, RESULTS
from nearlift.results.quotation import Results
from nearlift.results.serial import encode
from nearlift.rounding import fixed, like, plain
from nearlift.run import store

#: What of a run decides its numbers, and how a line of the table calls it.
PARTS = ("inputs", "manifest", "options", "versions", "code", "products", "report")


def run(a: Path, b: Path) -> dict[str, Any]:
    """What differs between two runs.

    Parameters
    ----------
    a, b : Path
        Each a folder with provenance.json (``processed/<campaign>``), or a workspace with one
        finished campaign in it.

    Returns
    -------
    dict
        ``schema``; ``runs``; for each of inputs, manifest, options, versions, code, products,
        report the entries that differ, as name -> [in A, in B] (None where absent; digests stand in
        full); ``same``, how many do not; ``verdicts``; ``coefficients`` with ``shift`` (B less A)
        and ``shift_in_u`` (over u of A: both runs may rest on the same data, so their uncertainties
        do not add); ``trials``, the rejected ones that differ.

    Raises
    ------
    UsageError
        Where a folder holds no finished run, or several.
    """
    folders = [_finished(path) for path in (a, b)]
    ledgers = [store.read_json(folder / PROVENANCE.file) for folder in folders]
    content: dict[str, Any] = {
        "schema": "nearlift.run_comparison/1",
        "runs": [
            {
                "folder": str(f),
                "campaign": p["campaign"],
                "nearlift": p["nearlift"],
                "platform": p["platform"],
            }
            for f, p in zip(folders, ledgers, strict=True)
        ],
        "same": {},
    }
    for part in PARTS:
        one, two = (_part(p, part) for p in ledgers)
        names = list(dict.fromkeys([*one, *two]))
        content[part] = {n: [one.get(n), two.get(n)] for n in names if one.get(n) != two.get(n)}
        content["same"][part] = len(names) - len(content[part])
    found = [_numbers(folder) for folder in folders]
    content["coefficients"] = [
        _moved(key, found[0].get(key), found[1].get(key))
        for key in dict.fromkeys([*found[0], *found[1]])
    ]
    said = [_verdicts(folder) for folder in folders]
    content["verdicts"] = {
        b: [said[0].get(b), said[1].get(b)] for b in dict.fromkeys([*said[0], *said[1]])
    }
    lost = [{t: r for s in p["stages"].values() for t, r in s["rejected"]} for p in ledgers]
    content["trials"] = {
        t: [lost[0].get(t), lost[1].get(t)]
        for t in dict.fromkeys([*lost[0], *lost[1]])
        if lost[0].get(t) != lost[1].get(t)
    }
    return content


def _finished(path: Path) -> Path:
    if (path / PROVENANCE.file).is_file():
        return path
    found = sorted(p.parent for p in path.glob(f"processed/*/{PROVENANCE.file}"))
    if len(found) == 1:
        return found[0]
    what = f"holds {len(found)} finished runs" if found else "holds no finished run"
    remedy = (
        f"name one of them: {', '.join(str(f) for f in found)}"
        if found
        else "name processed/CAMPAIGN, or the folder that was given as --out"
    )
    raise UsageError(str(path), what, remedy)


def _part(ledger: Mapping[str, Any], part: str) -> dict[str, Any]:
    """Name to value of one part; what stages have in common is told once."""
    if part == "inputs":
        return {name: entry["sha256"] for name, entry in ledger["inputs"].items()}
    if part in ("options", "versions"):
        return dict(ledger[part])
    stages: Mapping[str, Any] = ledger["stages"]
    if part == "manifest":
        return {
            f"[{section}]": digest
            for s in stages.values()
            for section, digest in s["material"]["manifest"].items()
        }
    if part == "code":
        return {name: s["material"]["code"] for name, s in stages.items()}
    home = {"products": "processed/", "report": "reports/"}[part]
    return {
        file.removeprefix(home): sha
        for s in stages.values()
        for file, sha in s["outputs"].items()
        if file.startswith(home)
    }


Key = tuple[str, str, str]


def _numbers(folder: Path) -> dict[Key, dict[str, float]]:
    """The coefficients that each run quotes: value, u and 90 % interval."""
    path = folder / RESULTS.file
    boundaries = store.load(path, Results).boundaries if path.is_file() else {}
    return {
        (boundary, own.base_model, name): {k: getattr(c, k) for k in ("value", "u", "lo90", "hi90")}
        for boundary, own in boundaries.items()
        for name, c in own.coefficients.items()
    }


def _moved(key: Key, one: dict[str, float] | None, two: dict[str, float] | None) -> dict[str, Any]:
    shift = in_u = None
    if one and two:
        shift = two["value"] - one["value"]
        in_u = shift / one["u"] if one["u"] else None
    names = dict(zip(("boundary", "model", "name"), key, strict=True))
    return {**names, "a": one, "b": two, "shift": shift, "shift_in_u": in_u}


def _verdicts(folder: Path) -> dict[str, str]:
    path = folder / RESULTS.file
    found = store.load(path, Results).boundaries if path.is_file() else {}
    return {
        b: own.verdict + (f": {', '.join(own.effects)}" if own.effects else "")
        for b, own in found.items()
    }


def table(content: Mapping[str, Any]) -> list[str]:
    """The comparison as lines of text: what differs, then the coefficients."""
    lines = [
        f"{letter}  {r['folder']}  (nearlift {r['nearlift']}, {r['campaign']})"
        for letter, r in zip("AB", content["runs"], strict=True)
    ]
    for part in PARTS:
        changed = content[part]
        same = content["same"][part]
        lines.append(
            f"{part}: {f'{len(changed)} differ, {same} the same' if changed else 'the same'}"
        )
        lines += [f"  {name}: {_side(one)} -> {_side(two)}" for name, (one, two) in changed.items()]
    if content["trials"]:
        lines.append("trials rejected:")
        lines += [
            f"  {trial}: {one or 'accepted'} -> {two or 'accepted'}"
            for trial, (one, two) in content["trials"].items()
        ]
    if content["verdicts"]:
        lines.append("verdicts:")
        lines += [
            f"  {b}: {one or '-'}" + ("" if one == two else f" -> {two or '-'}")
            for b, (one, two) in content["verdicts"].items()
        ]
    lines.append("coefficients (shift in u of A):")
    rows = [
        (f"{c['boundary']} {c['name']}", _estimate(c["a"]), _estimate(c["b"]), _shift(c))
        for c in content["coefficients"]
    ]
    wide = [max((len(row[i]) for row in rows), default=0) for i in range(3)]
    lines += [
        f"  {what:<{wide[0]}}  {one:<{wide[1]}}  {two:<{wide[2]}}  {shift}"
        for what, one, two, shift in rows
    ]
    return lines


def _side(value: Any) -> str:
    """A digest by its first letters, a version in full."""
    if value is None:
        return "absent"
    return value[:12] if isinstance(value, str) and len(value) == 64 else str(value)


def _estimate(e: Mapping[str, float] | None) -> str:
    if e is None:
        return "absent"
    value, low, high = (like(e[k], e["u"] or 0.0) for k in ("value", "lo90", "hi90"))
    return f"{value} ({low} to {high})"


def _shift(c: Mapping[str, Any]) -> str:
    if c["shift"] is None:
        return "-"
    if not c["shift"]:
        return "the same"
    return f"{plain(c['shift'], 2)}" + (
        f" = {fixed(c['shift_in_u'], 2)} u" if c["shift_in_u"] is not None else ""
    )


@declared("compare-runs")
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
def command(call: Call, a: Path, b: Path) -> None:
    """What differs."""
    content = run(a, b)
    call.answer(encode(content), "\n".join(table(content)))
