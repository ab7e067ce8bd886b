"""Rows to tables: ../shared/method.md's "Figures to reach" with exact intervals, a table per
effect, and one of rival methods.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import beta, binom
from tests.calibration import pages
from tests.calibration.forms import NAMED, STRANGE, UNNAMED
from tests.calibration.kinds import KINDS, STRONG, Promise
from tests.calibration.peers import PEERS

Row = dict[str, Any]
#: Effects that leave no mark on time, supply, temperature or approach: these trade with the
#: coefficients.
BY_TIME = frozenset(
    {
        "approach_backlash",
        "session_gain",
        "gain_drift",
        "warm_up",
        "supply_sag",
        "air_density",
        "zero_drift",
        "zero_temperature",
        "cell_creep",
    }
)
DISTANCE = frozenset(NAMED) - BY_TIME


NONE = Promise()


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One row of the table: a share with its Clopper-Pearson interval (k of n), or a quantile with
    that of order statistics.
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
        """False only where the whole 95 % interval lies on the wrong side of `must`; None where
        nothing is promised.
        """
        if self.promise.must is None:
            return None
        return (
            self.hi95 >= self.promise.must
            if self.promise.sense == ">="
            else self.lo95 <= self.promise.must
        )

    @property
    def brief(self) -> str:
        """A share as "k of n (95 % interval in per cent)"."""
        return f"{self.k} of {self.n} ({100 * self.lo95:.0f}-{100 * self.hi95:.0f})"


def clopper_pearson(k: int, n: int, level: float = 0.95) -> tuple[float, float]:
    """Exact binomial interval of a share."""
    tail = (1 - level) / 2
    return (float(beta.ppf(tail, k, n - k + 1)) if k else 0.0), (
        float(beta.ppf(1 - tail, k + 1, n - k)) if k < n else 1.0
    )


def share(
    key: str,
    title: str,
    among: list[Row],
    fact: str | Callable[[Row], bool],
    promise: Promise = NONE,
) -> Iterator[Figure]:
    """How often a fact holds; nothing where there are no rows."""
    hits = [bool(r[fact] if isinstance(fact, str) else fact(r)) for r in among]
    if hits:
        k, n = sum(hits), len(hits)
        low, high = clopper_pearson(k, n)
        yield Figure(
            key=key, title=title, value=k / n, lo95=low, hi95=high, n=n, k=k, promise=promise
        )


def quantile(
    key: str, title: str, values: list[float], q: float = 0.5, promise: Promise = NONE
) -> Iterator[Figure]:
    """A quantile with the interval that order statistics give it."""
    ordered = np.sort([v for v in values if np.isfinite(v)])
    n = len(ordered)
    if n:
        low, high = max(int(binom.ppf(0.025, n, q)) - 1, 0), min(int(binom.ppf(0.975, n, q)), n - 1)
        yield Figure(
            key=key,
            title=title,
            value=float(np.quantile(ordered, q)),
            lo95=float(ordered[low]),
            hi95=float(ordered[high]),
            n=n,
            promise=promise,
        )


@dataclass(frozen=True, kw_only=True)
class Fact:
    """What is counted in campaigns of every kind: among which of a kind's rows, and what; words for
    the head of a column.
    """

    words: str
    among: Callable[[Row], bool]
    counts: Callable[[Row], bool]


def _empty(r: Row) -> bool:
    return not r["truth"]


def _effect(r: Row) -> bool:
    return bool(r["truth"]) and not STRANGE.keys() & {*r["truth"]}


def _strange(r: Row) -> bool:
    return bool(STRANGE.keys() & {*r["truth"]})


FACTS: dict[str, Fact] = {
    "undiagnosed": Fact(
        words="not diagnosed", among=lambda r: True, counts=lambda r: bool(r["undiagnosed"])
    ),
    "null_claimed": Fact(words="null: any claim", among=_empty, counts=lambda r: r["claimed"]),
    "null_named": Fact(words="null: a name", among=_empty, counts=lambda r: r["named"]),
    "named_right": Fact(
        words="effect: best name right", among=_effect, counts=lambda r: r["right"]
    ),
    "named_inside": Fact(words="within the set", among=_effect, counts=lambda r: r["inside"]),
    "named_wrong": Fact(
        words="single and wrong", among=_effect, counts=lambda r: r["single_wrong"]
    ),
    "seen": Fact(words="outside: seen", among=_strange, counts=lambda r: r["claimed"]),
    "given_a_name": Fact(words="given a name", among=_strange, counts=lambda r: r["named"]),
    "covered": Fact(
        words="90 % interval to quote covers",
        among=lambda r: True,
        counts=lambda r: r["cover_quoted"],
    ),
    "covered_empty": Fact(
        words="... of empty campaigns", among=_empty, counts=lambda r: r["cover_quoted"]
    ),
    "covered_oracle": Fact(
        words="true model's covers", among=lambda r: True, counts=lambda r: r["cover_oracle"]
    ),
}
WIDTH = "width / true model's (90th percentile)"
RECORDS = frozenset(k.name for k in KINDS.values() if k.group == "records")


def _asked(done: list[Row]) -> Iterator[Figure]:
    """What each kind asks for."""
    for kind in KINDS.values():
        for key, promise in kind.asks.items():
            fact = FACTS[key]
            mine = [r for r in done if r["kind"] == kind.name and fact.among(r)]
            yield from share(
                f"{kind.name}_{key}", f"{kind.name}: {fact.words}", mine, fact.counts, promise
            )


def by_kind(rows: list[Row]) -> list[dict[str, Any]]:
    """Every fact of every kind but those of records, as "k of n (95 % interval)", and the
    interval's width over the true model's.
    """
    table = []
    for kind in (k for k in KINDS.values() if k.name not in RECORDS):
        run = [r for r in rows if r["kind"] == kind.name and "failed" in r]
        if not run:
            continue
        done = [r for r in run if r["failed"] == ""]
        raised = len(run) - len(done)
        wide = [r["width_quoted"] / r["oracle_width"] for r in done]
        entry: dict[str, Any] = {
            "kind": kind.name,
            "n": len(run),
            "raised": str(raised) if raised else "",
        }
        for fact in FACTS.values():
            entry[fact.words] = next(
                (f.brief for f in share("", "", [r for r in done if fact.among(r)], fact.counts)),
                "",
            )
        quantiles = np.quantile(wide, [0.5, 0.9]) if wide else None
        entry[WIDTH] = "" if quantiles is None else "{:.2f} ({:.2f})".format(*quantiles)
        entry["CPU s"] = float(np.median([r["cpu_s"] for r in done])) if done else math.nan
        table.append(entry)
    return table


def by_verdict(rows: list[Row]) -> list[dict[str, Any]]:
    """What the interval to quote is worth under each verdict, all kinds but those of records
    together.
    """
    table = []
    for verdict in ("adequate", "effect", "unexplained", "not_diagnosed"):
        mine = [r for r in rows if r.get("verdict") == verdict and r["kind"] not in RECORDS]
        for figure in share("", "", mine, "cover_quoted"):
            wide = np.quantile([r["width_quoted"] / r["oracle_width"] for r in mine], [0.5, 0.9])
            table.append(
                {
                    "verdict": verdict,
                    FACTS["covered"].words: figure.brief,
                    WIDTH: "{:.2f} ({:.2f})".format(*wide),
                }
            )
    return table


def by_structure(rows: list[Row]) -> list[dict[str, Any]]:
    """What becomes of each structure outside the library: how often it is seen, is given a name, and
    how often the interval to quote holds the coefficient where it is unexplained, and where the
    verdict is adequate.
    """
    table = []
    outside = [
        r for r in rows if r.get("failed") == "" and {*r.get("truth", ())} & {*UNNAMED, *STRANGE}
    ]
    for name in [n for n in (*UNNAMED, *STRANGE) if any(n in r["truth"] for r in outside)]:
        mine = [r for r in outside if name in r["truth"]]
        line: dict[str, Any] = {"structure": name, "n": len(mine)}
        line |= {w: sum(bool(r[w]) for r in mine) for w in ("claimed", "named")}
        for verdict in ("unexplained", "adequate"):
            held = [r["cover_quoted"] for r in mine if r["verdict"] == verdict]
            line[f"{verdict}: interval holds"] = f"{sum(held)} of {len(held)}"
        table.append(line)
    return table


def figures(rows: list[Row]) -> list[Figure]:
    """Every figure that these rows have something to say about."""
    done = [r for r in rows if r.get("failed") == ""]
    of = {kind: [r for r in done if r["kind"] == kind] for kind in KINDS}
    return [
        *share(
            "failed",
            "diagnoses that raised",
            [r for r in rows if "failed" in r],
            lambda r: r["failed"] != "",
            Promise("<=", 0.0, 0.0),
        ),
        *_asked(done),
        *_null(of["null"]),
        *_single(of["weak"], of["one"]),
        *_several(of["two"], of["outside"], of["within"]),
        *_held_out([r for r in done if r["kind"] in RECORDS], of["one"]),
        *_coverage(of["null"], of["one"]),
        *quantile(
            "time",
            "CPU seconds per boundary with held-out folds: median",
            [r["cpu_s"] for r in done],
            promise=Promise("<=", 4.0, 2.0),
        ),
        *quantile("time_p95", "... 95th percentile", [r["cpu_s"] for r in done], 0.95),
    ]


def _null(null: list[Row]) -> Iterator[Figure]:
    yield from share(
        "null", "null: any claim, at a stated 5 %", null, "claimed", Promise("<=", 0.05, 0.05)
    )
    yield from share(
        "null_clean",
        "... Gaussian noise, no wander",
        [r for r in null if not r["realism"]],
        "claimed",
    )
    yield from share(
        "null_real",
        "... tails, outliers and a wander of 0.03 %",
        [r for r in null if r["realism"]],
        "claimed",
    )
    yield from share("null_named", "... a name given", null, "named")


def _single(weak: list[Row], one: list[Row]) -> Iterator[Figure]:
    own, foreign = [r for r in one if not r["foreign"]], [r for r in one if r["foreign"]]
    yield from share(
        "weak_seen",
        "one effect, rho 0.1 to 0.2: seen at all",
        weak,
        "claimed",
        Promise(">=", 0.80, 0.90),
    )
    yield from share("weak_wrong", "... one single name, and wrong", weak, "single_wrong")
    yield from share("one_seen", "one effect, rho >= 0.2: seen at all", one, "claimed")
    yield from share(
        "one_right",
        "one effect, rho >= 0.2: best name right",
        one,
        "right",
        Promise(">=", 0.86, 0.92),
    )
    yield from share(
        "one_inside", "... truth within name + rivals", one, "inside", Promise(">=", 0.97, 0.98)
    )
    yield from share(
        "one_equal",
        "... truth, or its equal on that bench (r >= 0.99), within name + rivals",
        one,
        "equal",
    )
    yield from share(
        "one_wrong",
        "... one single name, and wrong",
        one,
        "single_wrong",
        Promise("<=", 0.02, 0.01),
    )
    yield from share("own_right", "... own form: best name right", own, "right")
    yield from share("own_inside", "... own form: within the set", own, "inside")
    yield from share(
        "foreign_right",
        "... foreign form: best name right",
        foreign,
        "right",
        Promise(">=", 0.70, 0.85),
    )
    yield from share(
        "foreign_inside",
        "... foreign form: within the set",
        foreign,
        "inside",
        Promise(">=", 0.80, 0.92),
    )
    yield from quantile(
        "set_size",
        "... size of the set where one is named: median",
        [float(r["set_size"]) for r in one if r["names"]],
    )
    yield from quantile(
        "set_size_p90",
        "... and 90th percentile",
        [float(r["set_size"]) for r in one if r["names"]],
        0.9,
    )


def _several(two: list[Row], outside: list[Row], within: list[Row]) -> Iterator[Figure]:
    faint, loud = (
        [r for r in outside if r["rho"] < STRONG],
        [r for r in outside if r["rho"] >= STRONG],
    )
    yield from share(
        "two_inside",
        "two effects, weaker rho 0.2 to 0.4: both within the set",
        two,
        "inside",
        Promise(">=", 0.85, 0.90),
    )
    yield from share("two_right", "... both named first", two, "right")
    yield from share(
        "two_some",
        "... at least one of them within the set",
        two,
        lambda r: bool({*r["truth"]} & {*r["names"], *r["rivals"]}),
    )
    yield from share(
        "outside_faint",
        "outside the library, rho 0.2 to 0.4: given a name",
        faint,
        "named",
        Promise("<=", 0.30, 0.15),
    )
    yield from share(
        "outside_loud",
        "outside the library, rho >= 0.4: given a name",
        loud,
        "named",
        Promise("<=", 0.03, 0.01),
    )
    yield from share("outside_seen", "outside the library: seen at all", outside, "claimed")
    unnamed = [r for r in outside if r["verdict"] == "unexplained"]
    yield from share(
        "outside_cover_base",
        "... unexplained: the base fit's 90 % interval holds the coefficient",
        unnamed,
        "cover_base",
    )
    yield from share(
        "outside_cover",
        "... with what is left carried",
        unnamed,
        "cover_quoted",
        Promise(">=", 0.82, 0.88),
    )
    yield from share(
        "within_seen",
        "motor heating within records (2 to 20 permille): named",
        within,
        lambda r: "motor_heating" in r["within"],
    )
    yield from share(
        "within_only", "... and nothing else claimed", within, lambda r: r["verdict"] == "adequate"
    )


def _held_out(done: list[Row], one: list[Row]) -> Iterator[Figure]:
    strong = [
        r
        for r in one
        if r["rho"] >= STRONG
        and r["oracle_after"] < r["oracle_before"]
        and r["expected_oracle"] < r["expected_before"]
    ]
    gain = [
        (1 - r["reported_after"] / r["reported_before"])
        / (1 - r["oracle_after"] / r["oracle_before"])
        for r in strong
    ]
    again = [
        (r["expected_before"] - r.get("expected_after", r["expected_before"]))
        / (r["expected_before"] - r["expected_oracle"])
        for r in strong
    ]
    scored = [r for r in done if math.isfinite(r["reported_after"])]
    yield from quantile(
        "gain",
        "held-out gain over the true model's, rho >= 0.4: median",
        gain,
        promise=Promise(">=", 0.90, 0.98),
    )
    yield from quantile("gain_p10", "... its tenth percentile", gain, 0.1)
    yield from quantile(
        "gain_again", "... on an independent repeat, with the model as reported: median", again
    )
    worse = Promise("<=", 0.03, 0.01)
    yield from share(
        "worse",
        "made worse on held-out trials, as reported",
        scored,
        lambda r: r["reported_after"] > r["reported_before"] * (1 + 1e-9),
        worse,
    )
    yield from share(
        "worse_again",
        "made worse on an independent repeat",
        scored,
        lambda r: r.get("expected_after", 0.0) > r["expected_before"],
    )


def _coverage(null: list[Row], one: list[Row]) -> Iterator[Figure]:
    intervals = {
        "base": "base fit",
        "refit": "refit after the loop",
        "quoted": "to be quoted",
        "oracle": "with the true model",
        "constrained": "undetected effects as nuisances",
    }
    spatial = [r for r in one if r["truth"][0] in DISTANCE]
    for key, words, among in (
        ("cover", "90 % interval on the coefficient, effect present", one),
        ("cover_distance", "... effects of distance and throttle only", spatial),
        ("cover_null", "... null campaigns", null),
    ):
        for kind, title in intervals.items():
            promise = Promise(">=", 0.87, 0.88) if (key, kind) == ("cover", "quoted") else NONE
            yield from share(
                f"{key}_{kind}",
                f"{words}: {title}",
                [r for r in among if f"cover_{kind}" in r],
                f"cover_{kind}",
                promise,
            )


def peer_table(rows: list[Row]) -> list[dict[str, Any]]:
    """../shared/method.md's first table from rows with `peers`; the diagnosis itself last."""
    rows = [r for r in rows if "peers" in r]
    null, inside, outside = (
        [r for r in rows if r["kind"] in k] for k in (("null",), ("weak", "one"), ("outside",))
    )
    table = []

    def line(method: str, pick: Callable[[Row], list[str]]) -> None:
        names = [(set(r["truth"]), pick(r)) for r in inside]
        given = sum(len(p) for _, p in names)
        table.append(
            {
                "method": method,
                "null: names something": _mean([bool(pick(r)) for r in null]),
                "exact answer": _mean([set(p) == t for t, p in names]),
                "false share of names": (
                    sum(len(set(p) - t) for t, p in names) / given if given else math.nan
                ),
                "outside the library: names something": _mean([bool(pick(r)) for r in outside]),
            }
        )

    for method in PEERS:
        line(method, lambda r, m=method: r["peers"][m])
    if any("names" in r for r in rows):
        line("nearlift", lambda r: r.get("names", []))
    return table


def _mean(values: list[bool]) -> float:
    return sum(values) / len(values) if values else math.nan


def by_effect(rows: list[Row]) -> list[dict[str, Any]]:
    """Per true effect: how often it was named first, was in the set, and what was named instead."""
    table = []
    one = [r for r in rows if r["kind"] == "one" and r.get("failed") == ""]
    for name in sorted({r["truth"][0] for r in one}):
        mine = [r for r in one if r["truth"][0] == name]
        instead = [n for r in mine for n in r["names"] or [r["verdict"]] if n != name]
        table.append(
            {
                "effect": name,
                "n": len(mine),
                "right": _mean([r["right"] for r in mine]),
                "inside": _mean([r["inside"] for r in mine]),
                "single and wrong": sum(r["single_wrong"] for r in mine),
                "covers": _mean([r["cover_quoted"] for r in mine]),
                "instead": ", ".join(
                    f"{n} {instead.count(n)}"
                    for n in sorted(set(instead), key=instead.count, reverse=True)[:3]
                ),
            }
        )
    return table


def markdown(rows: list[Row]) -> str:
    """The figures, the per-effect table and, where they were run, the rivals."""
    lines = [
        "| Figure | Value | 95 % interval | n | Must | Aim | |",
        "|---|---|---|---|---|---|---|",
    ]
    for f in figures(rows):
        show = (lambda v: f"{v:.3g}") if f.k is None else (lambda v: f"{100 * v:.1f} %")
        must, aim = (
            f"{f.promise.sense} {show(v)}" if v is not None else ""
            for v in (f.promise.must, f.promise.aim)
        )
        mark = {None: "", True: "holds", False: "**fails**"}[f.passed]
        lines.append(
            f"| {f.title} | {show(f.value)} | {show(f.lo95)} to {show(f.hi95)} | {f.n} | {must} |"
            f" {aim} | {mark} |"
        )
    peers = peer_table(rows) if any("peers" in r for r in rows) else []
    sections = (
        ("Per kind", by_kind(rows)),
        ("Per verdict", by_verdict(rows)),
        ("Per effect", by_effect(rows)),
        ("Per structure outside the library", by_structure(rows)),
        ("Rival methods", peers),
    )
    further = [f"\n## {title}\n\n{pages.table(table)}" for title, table in sections if table]
    return "\n".join(lines) + "\n" + "".join(further)
