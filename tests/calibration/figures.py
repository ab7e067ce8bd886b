"""Rows of the harness to tables: figures with exact intervals, and what becomes of each kind of
campaign, verdict, effect and structure.

    python -m tests.calibration.figures out/*.jsonl        writes a section of docs/coverage.md
"""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta, binom
from tests.calibration import pages
from tests.calibration.forms import STRANGE, UNNAMED
from tests.calibration.kinds import KINDS, STRONG, Promise
from tests.calibration.peers import PEERS

Row = dict[str, Any]
Test = Callable[[Row], bool]
NONE = Promise()
#: Effects that vary with time, supply, temperature or approach; all others trade with the
#: coefficients.
BY_TIME = {"approach_backlash", "session_gain", "gain_drift", "warm_up", "supply_sag"} | {
    "air_density",
    "zero_drift",
    "zero_temperature",
    "cell_creep",
}
VERDICTS = ("adequate", "effect", "unexplained")


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A share with its Clopper-Pearson interval (k of n), or a quantile with that of order
    statistics.
    """

    key: str
    title: str
    value: float
    lo95: float
    hi95: float
    n: int
    k: int | None = None
    promise: Promise = NONE

    @property
    def passed(self) -> bool | None:
        """False only where the whole interval is on the wrong side; None without a promise."""
        if self.promise.must is None:
            return None
        if self.promise.sense == ">=":
            return self.hi95 >= self.promise.must
        return self.lo95 <= self.promise.must

    @property
    def brief(self) -> str:
        """A share as "k of n (95 % interval in per cent)"."""
        return f"{self.k} of {self.n} ({100 * self.lo95:.0f}-{100 * self.hi95:.0f})"


def clopper_pearson(k: int, n: int, level: float = 0.95) -> tuple[float, float]:
    """Exact binomial interval of a share."""
    tail = (1 - level) / 2
    low = float(beta.ppf(tail, k, n - k + 1)) if k else 0.0
    return low, float(beta.ppf(1 - tail, k + 1, n - k)) if k < n else 1.0


def share(
    key: str, title: str, rows: list[Row], fact: str | Test, promise: Promise = NONE
) -> Iterator[Figure]:
    """How often a fact holds; nothing where no row has it."""
    if isinstance(fact, str):
        facts = [bool(r[fact]) for r in rows if fact in r]
    else:
        facts = [bool(fact(r)) for r in rows]
    if facts:
        k, n = sum(facts), len(facts)
        low, high = clopper_pearson(k, n)
        yield Figure(
            key=key, title=title, value=k / n, lo95=low, hi95=high, n=n, k=k, promise=promise
        )


def quantile(
    key: str, title: str, values: list[float], q: float = 0.5, promise: Promise = NONE
) -> Iterator[Figure]:
    """A quantile with the interval of order statistics."""
    x = np.sort([v for v in values if np.isfinite(v)])
    n = len(x)
    if n:
        low, high = max(int(binom.ppf(0.025, n, q)) - 1, 0), min(int(binom.ppf(0.975, n, q)), n - 1)
        yield Figure(
            key=key,
            title=title,
            value=float(np.quantile(x, q)),
            lo95=float(x[low]),
            hi95=float(x[high]),
            n=n,
            promise=promise,
        )


# Shares that are reported: key, title, rows (kind and a test), fact, promise.


def _of(kind: str, test: Test = lambda r: True) -> Test:
    return lambda r: r["kind"] == kind and test(r)


def _spatial(r: Row) -> bool:
    return r["truth"][0] not in BY_TIME


def _some(r: Row) -> bool:
    return bool({*r["truth"]} & {*r["names"], *r["rivals"]})


FOREIGN = _of("one", lambda r: r["foreign"])
OWN = _of("one", lambda r: not r["foreign"])
OUTSIDE_UNEXPLAINED = _of("outside", lambda r: r["verdict"] == "unexplained")
SHARES: tuple[tuple[str, str, Test, str | Test, Promise], ...] = (
    ("null", "null: any claim, at a stated 5 %", _of("null"), "claimed", Promise("<=", 0.05, 0.05)),
    ("null_named", "null: a name given", _of("null"), "named", NONE),
    (
        "weak_seen",
        "one effect, rho 0.1 to 0.2: detected",
        _of("weak"),
        "claimed",
        Promise(">=", 0.80, 0.90),
    ),
    ("weak_wrong", "... one single name, and wrong", _of("weak"), "single_wrong", NONE),
    ("one_seen", "one effect, rho >= 0.2: detected", _of("one"), "claimed", NONE),
    ("one_right", "... best name right", _of("one"), "right", Promise(">=", 0.86, 0.92)),
    ("one_inside", "... truth within the set", _of("one"), "inside", Promise(">=", 0.97, 0.98)),
    ("one_equal", "... truth, or its equal there (r >= 0.99)", _of("one"), "equal", NONE),
    (
        "one_wrong",
        "... one single name, and wrong",
        _of("one"),
        "single_wrong",
        Promise("<=", 0.02, 0.01),
    ),
    ("own_right", "... own form: best name right", OWN, "right", NONE),
    ("own_inside", "... own form: within the set", OWN, "inside", NONE),
    (
        "foreign_right",
        "... foreign form: best name right",
        FOREIGN,
        "right",
        Promise(">=", 0.70, 0.85),
    ),
    (
        "foreign_inside",
        "... foreign form: within the set",
        FOREIGN,
        "inside",
        Promise(">=", 0.80, 0.92),
    ),
    (
        "two_inside",
        "two effects, weaker rho 0.2 to 0.4: both within the set",
        _of("two"),
        "inside",
        Promise(">=", 0.85, 0.90),
    ),
    ("two_right", "... both named first", _of("two"), "right", NONE),
    ("two_some", "... at least one within the set", _of("two"), _some, NONE),
    (
        "outside_faint",
        "outside the library, rho 0.2 to 0.4: named",
        _of("outside", lambda r: r["rho"] < STRONG),
        "named",
        Promise("<=", 0.30, 0.15),
    ),
    (
        "outside_loud",
        "outside the library, rho >= 0.4: named",
        _of("outside", lambda r: r["rho"] >= STRONG),
        "named",
        Promise("<=", 0.03, 0.01),
    ),
    ("outside_seen", "outside the library: detected", _of("outside"), "claimed", NONE),
    (
        "outside_cover",
        "... unexplained: the quoted 90 % interval holds",
        OUTSIDE_UNEXPLAINED,
        "cover_quoted",
        Promise(">=", 0.82, 0.88),
    ),
    (
        "within_seen",
        "motor heating within records (2 to 20 permille): named",
        _of("within"),
        lambda r: "motor_heating" in r["within"],
        NONE,
    ),
    (
        "within_only",
        "... and nothing else claimed",
        _of("within"),
        lambda r: r["verdict"] == "adequate",
        NONE,
    ),
    *(
        (f"{key}_{kind}", f"{words}: {title}", among, f"cover_{kind}", promise)
        for key, words, among in (
            ("cover", "90 % interval on the coefficient, one effect", _of("one")),
            ("cover_distance", "... effects of distance and throttle", _of("one", _spatial)),
            ("cover_null", "... null campaigns", _of("null")),
        )
        for kind, title, promise in (
            ("base", "base fit", NONE),
            ("quoted", "quoted", Promise(">=", 0.87, 0.88) if key == "cover" else NONE),
            ("oracle", "with the true model", NONE),
        )
    ),
)
#: What is counted in campaigns of every kind: words, rows, fact.
FACTS: dict[str, tuple[str, Test, Test]] = {
    "undiagnosed": ("not diagnosed", lambda r: True, lambda r: bool(r["undiagnosed"])),
    "null_claimed": ("null: any claim", lambda r: not r["truth"], lambda r: r["claimed"]),
    "null_named": ("null: a name", lambda r: not r["truth"], lambda r: r["named"]),
    "named_right": (
        "effect: best name right",
        lambda r: bool(r["truth"]) and not _strange(r),
        lambda r: r["right"],
    ),
    "named_inside": (
        "within the set",
        lambda r: bool(r["truth"]) and not _strange(r),
        lambda r: r["inside"],
    ),
    "named_wrong": (
        "single and wrong",
        lambda r: bool(r["truth"]) and not _strange(r),
        lambda r: r["single_wrong"],
    ),
    "seen": ("outside: detected", lambda r: _strange(r), lambda r: r["claimed"]),
    "given_a_name": ("given a name", lambda r: _strange(r), lambda r: r["named"]),
    "covered": ("quoted 90 % interval covers", lambda r: True, lambda r: r["cover_quoted"]),
    "covered_empty": (
        "... of null campaigns",
        lambda r: not r["truth"],
        lambda r: r["cover_quoted"],
    ),
    "covered_oracle": ("true model's covers", lambda r: True, lambda r: r["cover_oracle"]),
}
RECORDS = {k.name for k in KINDS.values() if k.group == "records"}


def _strange(r: Row) -> bool:
    return bool(STRANGE.keys() & {*r["truth"]})


def figures(rows: list[Row]) -> list[Figure]:
    """Every figure that these rows determine."""
    ran = [r for r in rows if "failed" in r]
    done = [r for r in ran if r["failed"] == ""]
    none_fails = Promise("<=", 0.0, 0.0)
    each = [*share("failed", "diagnoses that raised", ran, lambda r: r["failed"] != "", none_fails)]
    for kind in KINDS.values():
        for key, promise in kind.asks.items():
            words, among, fact = FACTS[key]
            mine = [r for r in done if r["kind"] == kind.name and among(r)]
            each += share(f"{kind.name}_{key}", f"{kind.name}: {words}", mine, fact, promise)
    for key, title, among, fact, promise in SHARES:
        each += share(key, title, [r for r in done if among(r)], fact, promise)
    named = [float(r["set_size"]) for r in done if r["kind"] == "one" and r["names"]]
    each += quantile("set_size", "size of the set where one is named: median", named)
    each += quantile("set_size_p90", "... and 90th percentile", named, 0.9)
    each += _held_out([r for r in done if r["kind"] in RECORDS])
    times = [r["cpu_s"] for r in done]
    limit = Promise("<=", 4.0, 2.0)
    each += quantile("time", "CPU seconds per boundary: median", times, promise=limit)
    each += quantile("time_p95", "... 95th percentile", times, 0.95)
    return each


def _held_out(done: list[Row]) -> Iterator[Figure]:
    """Reduction of the error on visits left out, over that by the true model."""
    gain = [
        (1 - r["reported_after"] / r["reported_before"])
        / (1 - r["oracle_after"] / r["oracle_before"])
        for r in done
        if r["kind"] == "one"
        and r["rho"] >= STRONG
        and r["oracle_after"] < r["oracle_before"]
        and r["expected_oracle"] < r["expected_before"]
    ]
    scored = [r for r in done if math.isfinite(r["reported_after"])]
    most = Promise(">=", 0.90, 0.98)
    yield from quantile(
        "gain", "held-out gain over the true model's, rho >= 0.4: median", gain, promise=most
    )
    yield from quantile("gain_p10", "... its tenth percentile", gain, 0.1)
    yield from share(
        "worse",
        "made worse on held-out trials, as reported",
        scored,
        lambda r: r["reported_after"] > r["reported_before"] * (1 + 1e-9),
        Promise("<=", 0.03, 0.01),
    )
    yield from share(
        "worse_again",
        "made worse on an independent repeat",
        scored,
        lambda r: r.get("expected_after", 0.0) > r["expected_before"],
    )


# tables


def _brief(rows: list[Row], fact: str | Test) -> str:
    return next((f.brief for f in share("", "", rows, fact)), "")


def _width(rows: list[Row], *quantiles: float) -> list[float]:
    """Quantiles of the quoted interval's width over the true model's."""
    return np.quantile([r["width_quoted"] / r["oracle_width"] for r in rows], quantiles).tolist()


def by_kind(rows: list[Row]) -> list[Row]:
    """Every fact of every kind but those of records, and the interval's width."""
    table = []
    for kind in (k for k in KINDS if k not in RECORDS):
        ran = [r for r in rows if r["kind"] == kind and "failed" in r]
        done = [r for r in ran if r["failed"] == ""]
        if not done:
            continue
        facts = {
            w: _brief([r for r in done if among(r)], fact) for w, among, fact in FACTS.values()
        }
        table.append(
            {"kind": kind, "n": len(ran), "raised": len(ran) - len(done)}
            | facts
            | {
                "width / true model's (90th percentile)": "{:.2f} ({:.2f})".format(
                    *_width(done, 0.5, 0.9)
                )
            }
        )
    return table


def by_verdict(rows: list[Row]) -> list[Row]:
    """Coverage of the quoted interval: a line for each kind of campaign, a cell for each verdict."""
    kinds: dict[str, Test] = {
        "null": lambda r: not r["truth"],
        "one effect of the library": _of("one"),
        "two effects": _of("two"),
        "structure outside the library": _of("outside"),
        "strange structure": lambda r: r["kind"] in r["truth"],
        "an effect under drifting noise": lambda r: (
            bool(r["truth"]) and r["kind"] in ("wander", "ar_95")
        ),
        "**all**": lambda r: True,
    }

    def cell(mine: list[Row]) -> str:
        return f"{_brief(mine, 'cover_quoted')}, {_width(mine, 0.5)[0]:.2f}" if mine else "-"

    return [
        {"campaign": words}
        | {v: cell([r for r in mine if r["verdict"] == v]) for v in VERDICTS}
        | {"all": cell(mine)}
        for words, among in kinds.items()
        if (mine := [r for r in rows if among(r)])
    ]


def by_structure(rows: list[Row]) -> list[Row]:
    """Claims, names and coverage for each structure outside the library."""
    table = []
    for name in (*UNNAMED, *STRANGE):
        mine = [r for r in rows if r.get("failed") == "" and name in r["truth"]]
        line: Row = {"structure": name, "n": len(mine)}
        line |= {w: sum(bool(r[w]) for r in mine) for w in ("claimed", "named")}
        for verdict in ("unexplained", "adequate"):
            held = [r["cover_quoted"] for r in mine if r["verdict"] == verdict]
            line[f"{verdict}: interval holds"] = f"{sum(held)} of {len(held)}"
        if mine:
            table.append(line)
    return table


def by_effect(rows: list[Row]) -> list[Row]:
    """How often each true effect was named first, was in the set, and what was named instead."""
    one = [r for r in rows if r["kind"] == "one" and r.get("failed") == ""]
    table = []
    for name in sorted({r["truth"][0] for r in one}):
        mine = [r for r in one if r["truth"][0] == name]
        instead = Counter(n for r in mine for n in r["names"] or [r["verdict"]] if n != name)
        table.append(
            {
                "effect": name,
                "n": len(mine),
                "right": _mean(mine, lambda r: r["right"]),
                "inside": _mean(mine, lambda r: r["inside"]),
                "instead": ", ".join(f"{n} ({k})" for n, k in instead.most_common(3)),
            }
        )
    return table


def peer_table(rows: list[Row]) -> list[Row]:
    """Rival methods, from rows with `peers`; the diagnosis itself last."""
    rows = [r for r in rows if "peers" in r]
    methods: dict[str, Callable[[Row], list[str]]] = {
        method: lambda r, m=method: r["peers"][m] for method in PEERS
    }
    if any("names" in r for r in rows):
        methods["nearlift"] = lambda r: r.get("names", [])
    null, inside, outside = (
        [r for r in rows if r["kind"] in kinds]
        for kinds in (("null",), ("weak", "one"), ("outside",))
    )
    table = []
    for method, pick in methods.items():
        given = sum(len(pick(r)) for r in inside)
        false = sum(len({*pick(r)} - {*r["truth"]}) for r in inside)
        table.append(
            {
                "method": method,
                "null: names something": _mean(null, pick),
                "exact answer": _mean(inside, lambda r, p=pick: {*p(r)} == {*r["truth"]}),
                "false share of names": false / given if given else math.nan,
                "outside the library: names something": _mean(outside, pick),
            }
        )
    return table


def _mean(rows: list[Row], fact: Callable[[Row], Any]) -> float:
    return sum(bool(fact(r)) for r in rows) / len(rows) if rows else math.nan


def markdown(rows: list[Row]) -> str:
    """The figures and all tables."""
    lines = [
        "| Figure | Value | 95 % interval | n | Must | Aim | |",
        "|---|---|---|---|---|---|---|",
    ]
    for f in figures(rows):
        show = "{:.3g}".format if f.k is None else "{:.1%}".format
        must, aim = (
            f"{f.promise.sense} {show(v)}" if v is not None else ""
            for v in (f.promise.must, f.promise.aim)
        )
        mark = {None: "", True: "holds", False: "**fails**"}[f.passed]
        lines.append(
            f"| {f.title} | {show(f.value)} | {show(f.lo95)} to {show(f.hi95)} | {f.n} | {must} |"
            f" {aim} | {mark} |"
        )
    good = [r for r in rows if r.get("failed") == ""]
    sections = {
        "Per kind": by_kind(rows),
        "Per verdict": by_verdict(good),
        "Per effect": by_effect(rows),
        "Per structure outside the library": by_structure(rows),
        "Rival methods": peer_table(rows),
    }
    further = [
        f"\n## {title}\n\n{pages.table(table)}" for title, table in sections.items() if table
    ]
    return "\n".join(lines) + "\n" + "".join(further)


BODY = """## The number to quote

    python -m tests.calibration.figures out/records.jsonl out/pairs.jsonl out/strange.jsonl

90 % intervals of `results.json` that hold the coefficient, by kind of campaign and verdict, in the {n} campaigns of [calibration](calibration.md): count, 95 % limits of the share, and median width over that
of a fit with the true model and covariance. The engine is that of 2026-11-26.
Of 675 campaigns of 400 trials today's intervals hold 86 % where *adequate* or *effect*, 77 % where *unexplained* ([Probabilities](calibration.md#probabilities)).

{verdicts}
Structures outside the library: how many make a claim, how many get a name, and how often the interval holds the coefficient.

{structures}"""


def main() -> None:
    """Write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=Path("docs/coverage.md"))
    given = parser.parse_args()
    rows = [json.loads(line) for path in given.rows for line in path.read_text().splitlines()]
    rows = [r for r in rows if r["failed"] == ""]
    tables = {"verdicts": by_verdict(rows), "structures": by_structure(rows)}
    body = BODY.format(n=len(rows), **{k: pages.table(t) for k, t in tables.items()})
    pages.write(given.out, "verdicts", body)


if __name__ == "__main__":
    main()
