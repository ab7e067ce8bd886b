"""Rows of the harness to tables: shares with exact intervals, by kind of campaign, verdict, effect
and structure.

    python -m tests.calibration.figures out/*.jsonl        writes two tables of docs/coverage.md
"""

from __future__ import annotations

import io
import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binom, binomtest
from tests.calibration.forms import STRANGE, UNNAMED
from tests.calibration.kinds import KINDS, Promise
from tests.calibration.programs import Row, read

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
RECORDS = [k.name for k in KINDS.values() if k.group == "records"]


def _table(text: str) -> pd.DataFrame:
    lines = io.StringIO(text.strip())
    # "null" is a kind of campaign, not a missing value
    how = {"engine": "python", "dtype": str, "keep_default_na": False}
    return pd.read_csv(lines, sep=r"\s*\|\s*", **how).set_index("key")


#: Shares that are reported, of the rows that a query finds.
SHARES = _table("""
key | title | where | fact | sense | must | aim
null | null: any claim, at a stated 5 % | kind == 'null' | claimed | <= | 0.05 | 0.05
null_named | null: a name given | kind == 'null' | named | | |
weak_seen | one effect, rho 0.1 to 0.2: detected | kind == 'weak' | claimed | >= | 0.80 | 0.90
weak_wrong | ... one single name, and wrong | kind == 'weak' | single_wrong | | |
one_seen | one effect, rho >= 0.2: detected | kind == 'one' | claimed | | |
one_right | ... best name right | kind == 'one' | right | >= | 0.86 | 0.92
one_inside | ... truth within the set | kind == 'one' | inside | >= | 0.97 | 0.98
one_equal | ... truth, or its equal there (r >= 0.99) | kind == 'one' | equal | | |
one_wrong | ... one single name, and wrong | kind == 'one' | single_wrong | <= | 0.02 | 0.01
own_right | ... own form: best name right | kind == 'one' and not foreign | right | | |
own_inside | ... own form: within the set | kind == 'one' and not foreign | inside | | |
foreign_right | ... foreign form: best name right | kind == 'one' and foreign | right | >= | 0.70 | 0.85
foreign_inside | ... foreign form: within the set | kind == 'one' and foreign | inside | >= | 0.80 | 0.92
two_inside | two effects, weaker rho 0.2 to 0.4: both within the set | kind == 'two' | inside | >= | 0.85 | 0.90
two_right | ... both named first | kind == 'two' | right | | |
two_some | ... at least one within the set | kind == 'two' | some | | |
outside_faint | outside the library, rho 0.2 to 0.4: named | kind == 'outside' and rho < 0.4 | named | <= | 0.30 | 0.15
outside_loud | outside the library, rho >= 0.4: named | kind == 'outside' and rho >= 0.4 | named | <= | 0.03 | 0.01
outside_seen | outside the library: detected | kind == 'outside' | claimed | | |
outside_cover | ... unexplained: the quoted 90 % interval holds | kind == 'outside' and verdict == 'unexplained' | cover_quoted | >= | 0.82 | 0.88
within_seen | motor heating within records (2 to 20 permille): named | kind == 'within' | heated | | |
within_only | ... and nothing else claimed | kind == 'within' | adequate | | |
cover_base | 90 % interval on the coefficient, one effect: base fit | kind == 'one' | cover_base | | |
cover_quoted | ... quoted | kind == 'one' | cover_quoted | >= | 0.87 | 0.88
cover_oracle | ... with the true model | kind == 'one' | cover_oracle | | |
cover_distance_base | ... effects of distance and throttle: base fit | kind == 'one' and spatial | cover_base | | |
cover_distance_quoted | ... quoted | kind == 'one' and spatial | cover_quoted | | |
cover_distance_oracle | ... with the true model | kind == 'one' and spatial | cover_oracle | | |
cover_null_base | ... null campaigns: base fit | kind == 'null' | cover_base | | |
cover_null_quoted | ... quoted | kind == 'null' | cover_quoted | | |
cover_null_oracle | ... with the true model | kind == 'null' | cover_oracle | | |
worse | made worse on held-out trials, as reported | kind in @RECORDS and scored | worse | <= | 0.03 | 0.01
""")
#: Shares in campaigns of every kind.
FACTS = _table("""
key | title | where | fact
undiagnosed | not diagnosed | n == n | undiagnosed
null_claimed | null: any claim | empty | claimed
null_named | null: a name | empty | named
named_right | effect: best name right | not empty and not strange | right
named_inside | within the set | not empty and not strange | inside
named_wrong | single and wrong | not empty and not strange | single_wrong
seen | outside: detected | strange | claimed
given_a_name | given a name | strange | named
covered | quoted 90 % interval covers | n == n | cover_quoted
covered_empty | ... of null campaigns | empty | cover_quoted
covered_oracle | true model's covers | n == n | cover_oracle
""")


def clopper_pearson(k: int, n: int, level: float = 0.95) -> tuple[float, float]:
    """Exact binomial interval of a share."""
    low, high = binomtest(k, n).proportion_ci(level, "exact")
    return float(low), float(high)


def brief(facts: pd.Series) -> str:
    """A share as "k of n (95 % interval in per cent)"."""
    if facts.empty:
        return ""
    low, high = clopper_pearson(k := int(facts.sum()), n := len(facts))
    return f"{k} of {n} ({100 * low:.0f}-{100 * high:.0f})"


def frame(rows: list[Row]) -> pd.DataFrame:
    """Rows whose diagnosis ended, with the facts that figures count."""
    done = [r for r in rows if r.get("failed") == ""]
    made = pd.DataFrame(done).assign(n=1.0)
    optional = ("names", "rivals", "within", "undiagnosed", "reported_after", "reported_before")
    for name in optional:
        made[name] = [r.get(name, [] if name in optional[:3] else np.nan) for r in done]

    def fact(test: Any) -> list[bool]:
        return [bool(test(r)) for r in made.to_dict("records")]

    return made.assign(
        empty=fact(lambda r: not r["truth"]),
        strange=fact(lambda r: STRANGE.keys() & {*r["truth"]}),
        spatial=fact(lambda r: r["truth"] and r["truth"][0] not in BY_TIME),
        some=fact(lambda r: {*r["truth"]} & {*r["names"], *r["rivals"]}),
        heated=fact(lambda r: "motor_heating" in r["within"]),
        adequate=fact(lambda r: r["verdict"] == "adequate"),
        undiagnosed=fact(lambda r: r["verdict"] == "not_diagnosed"),
        scored=np.isfinite(made["reported_after"].astype(float)),
        worse=made["reported_after"] > made["reported_before"] * (1 + 1e-9),
    )


def _facts(data: pd.DataFrame, row: pd.Series) -> pd.Series:
    """Whether a fact holds, in the rows of a figure that have it."""
    if row["fact"] not in data:
        return pd.Series(dtype=bool)
    return data.query(row["where"])[row["fact"]].dropna().astype(bool)


def _figure(key: str, title: str, promise: Promise, **found: Any) -> Row:
    return {"key": key, "title": title, "k": np.nan, **found, **promise._asdict()}


def _share(key: str, title: str, facts: pd.Series, promise: Promise = NONE) -> Iterator[Row]:
    if n := len(facts):
        k = int(facts.sum())
        low, high = clopper_pearson(k, n)
        yield _figure(key, title, promise, value=k / n, lo95=low, hi95=high, n=n, k=k)


def _quantile(
    key: str, title: str, values: pd.Series, q: float = 0.5, promise: Promise = NONE
) -> Iterator[Row]:
    """A quantile with the interval of order statistics."""
    x = np.sort(values[np.isfinite(values)])
    if n := len(x):
        low, high = max(int(binom.ppf(0.025, n, q)) - 1, 0), min(int(binom.ppf(0.975, n, q)), n - 1)
        value = float(np.quantile(x, q))
        yield _figure(key, title, promise, value=value, lo95=x[low], hi95=x[high], n=n)


def figures(rows: list[Row]) -> pd.DataFrame:
    """Every figure that these rows determine, by key. `passed` is False only where the whole
    interval is on the wrong side, None without a promise.
    """
    ran = [r for r in rows if "failed" in r]
    raised = pd.Series([r["failed"] != "" for r in ran])
    each = [*_share("failed", "diagnoses that raised", raised, Promise("<=", 0.0, 0.0))]
    if not raised.all():
        each += _of_diagnoses(frame(rows))
    found = pd.DataFrame(each).set_index("key").reindex(columns=[*each[0]][1:]).astype(object)
    found["passed"] = [
        None if f.sense == "" else bool(f.hi95 >= f.must if f.sense == ">=" else f.lo95 <= f.must)
        for f in found.itertuples()
    ]
    return found


def _of_diagnoses(data: pd.DataFrame) -> Iterator[Row]:
    for kind in KINDS.values():
        for key, promise in kind.asks.items():
            facts = _facts(data[data["kind"] == kind.name], FACTS.loc[key])
            yield from _share(
                f"{kind.name}_{key}", f"{kind.name}: {FACTS.loc[key, 'title']}", facts, promise
            )
    for key, row in SHARES.iterrows():
        limits = (row["sense"], float(row["must"]), float(row["aim"])) if row["sense"] else ()
        yield from _share(str(key), row["title"], _facts(data, row), Promise(*limits))
    one = data.query("kind == 'one'")
    sizes = one[[bool(n) for n in one["names"]]].get("set_size", pd.Series(dtype=float))
    yield from _quantile("set_size", "size of the set where one is named: median", sizes)
    yield from _quantile("set_size_p90", "... and 90th percentile", sizes, 0.9)
    if "oracle_after" in one:
        strong = one.query(
            "rho >= 0.4 and oracle_after < oracle_before and expected_oracle < expected_before"
        )
        gain = 1 - strong["reported_after"] / strong["reported_before"]
        gain /= 1 - strong["oracle_after"] / strong["oracle_before"]
        title = "held-out gain over the true model's, rho >= 0.4: median"
        yield from _quantile("gain", title, gain, promise=Promise(">=", 0.90, 0.98))
        yield from _quantile("gain_p10", "... its tenth percentile", gain, 0.1)
    limit = Promise("<=", 4.0, 2.0)
    yield from _quantile("time", "CPU seconds per boundary: median", data["cpu_s"], promise=limit)
    yield from _quantile("time_p95", "... 95th percentile", data["cpu_s"], 0.95)


# tables


def _width(data: pd.DataFrame, q: float = 0.5) -> float:
    """A quantile of the quoted interval's width over the true model's."""
    return float((data["width_quoted"] / data["oracle_width"]).quantile(q))


def by_kind(data: pd.DataFrame) -> pd.DataFrame:
    """Every fact of every kind but those of records, and the interval's width."""
    width = "width / true model's (90th percentile)"
    return pd.DataFrame(
        {"kind": kind, "n": len(mine)}
        | {row["title"]: brief(_facts(mine, row)) for _, row in FACTS.iterrows()}
        | {width: f"{_width(mine):.2f} ({_width(mine, 0.9):.2f})"}
        for kind, mine in data[~data["kind"].isin(RECORDS)].groupby("kind", sort=False)
    )


def by_verdict(data: pd.DataFrame) -> pd.DataFrame:
    """Coverage of the quoted interval: a line for each kind of campaign, a cell for each verdict."""
    kinds = {
        "null": "empty",
        "one effect of the library": "kind == 'one'",
        "two effects": "kind == 'two'",
        "structure outside the library": "kind == 'outside'",
        "strange structure": "strange",
        "an effect under drifting noise": "not empty and kind in ('wander', 'ar_95')",
        "**all**": "n == n",
    }

    def cell(mine: pd.DataFrame) -> str:
        return f"{brief(mine['cover_quoted'])}, {_width(mine):.2f}" if len(mine) else "-"

    return pd.DataFrame(
        {"campaign": words}
        | {v: cell(mine[mine["verdict"] == v]) for v in VERDICTS}
        | {"all": cell(mine)}
        for words, among in kinds.items()
        if len(mine := data.query(among))
    )


def by_structure(data: pd.DataFrame) -> pd.DataFrame:
    """Claims, names and coverage for each structure outside the library."""
    lines = []
    for name in (*UNNAMED, *STRANGE):
        mine = data[[name in truth for truth in data["truth"]]]
        held = {v: mine[mine["verdict"] == v]["cover_quoted"] for v in ("unexplained", "adequate")}
        if len(mine):
            lines.append(
                {"structure": name, "n": len(mine)}
                | {fact: int(mine[fact].sum()) for fact in ("claimed", "named")}
                | {f"{v}: interval holds": f"{h.sum()} of {len(h)}" for v, h in held.items()}
            )
    return pd.DataFrame(lines)


def by_effect(data: pd.DataFrame) -> pd.DataFrame:
    """How often each true effect was named first, was in the set, and what was named instead."""
    one, lines = data.query("kind == 'one'"), []
    for name, mine in one.groupby(one["truth"].str[0]):
        pairs = zip(mine["names"], mine["verdict"], strict=True)
        instead = Counter(n for names, verdict in pairs for n in names or [verdict] if n != name)
        lines.append(
            {"effect": name, "n": len(mine)}
            | {fact: mine[fact].astype(float).mean() for fact in ("right", "inside")}
            | {"instead": ", ".join(f"{n} ({k})" for n, k in instead.most_common(3))}
        )
    return pd.DataFrame(lines)


def table(data: pd.DataFrame) -> str:
    """A table in Markdown, numbers to two decimals."""
    lines = [[*data.columns], ["---"] * len(data.columns)]
    lines += [[f"{v:.2f}" if isinstance(v, float) else str(v) for v in r] for r in data.to_numpy()]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def write(page: Path, name: str, made: str) -> None:
    """Put a table between its markers, `<!-- name -->` and `<!-- end of name -->`, on the page."""
    start, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
    text = page.read_text(encoding="utf-8")
    pattern = f"{re.escape(start)}[^<]*{re.escape(end)}"
    text, count = re.subn(pattern, lambda _: f"{start}{made.strip()}\n{end}", text)
    assert count == 1, f"{page} has no place for {name}"
    page.write_text(text, encoding="utf-8")


def markdown(rows: list[Row]) -> str:
    """The figures and all tables."""
    lines = []
    for f in figures(rows).itertuples():
        show = "{:.3g}".format if np.isnan(f.k) else "{:.1%}".format
        must, aim = ("" if f.sense == "" else f"{f.sense} {show(v)}" for v in (f.must, f.aim))
        mark = {None: "", True: "holds", False: "**fails**"}[f.passed]
        ends = f"{show(f.lo95)} to {show(f.hi95)}"
        lines.append([f.title, show(f.value), ends, f.n, must, aim, mark])
    head = ["Figure", "Value", "95 % interval", "n", "Must", "Aim", ""]
    text = table(pd.DataFrame(lines, columns=head, dtype=object))
    data = frame(rows) if any(r.get("failed") == "" for r in rows) else None
    if data is None:
        return text
    sections = {
        "Per kind": by_kind(data),
        "Per verdict": by_verdict(data),
        "Per effect": by_effect(data),
        "Per structure outside the library": by_structure(data),
    }
    return text + "".join(f"\n## {t}\n\n{table(made)}" for t, made in sections.items() if len(made))


def main(files: list[str]) -> None:
    """Write the tables."""
    page = Path(__file__).parents[2] / "docs" / "coverage.md"
    data = frame([row for file in files for row in read(Path(file))])
    write(page, "verdicts", table(by_verdict(data)))
    write(page, "structures", table(by_structure(data)))


if __name__ == "__main__":
    main(sys.argv[1:])
