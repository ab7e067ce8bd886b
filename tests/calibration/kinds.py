"""Every kind of campaign in one list: how a seed becomes one, and what is asked of its diagnosis.

A kind belongs to a group, and a run takes either by name. `records` are simulated from load-cell
records; all others trial by trial, which is faster and lets noise, design and geometry depart from
what any engine may assume. Where nothing else is said, every other three seeds hold one effect.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from tests.calibration import forms
from tests.calibration.bench import THROTTLES, stream
from tests.calibration.simulator import Campaign, Errors, Shared, Spec, Unreachable, simulate

REPORTED = 600_000  # seeds from here on are for reporting; tune on others
STRONG = 0.4
EIGHT_THROTTLES = tuple(np.linspace(0.3, 0.9, 8).round(3).tolist())
RHO = {"weak": (0.1, 0.2), "one": (0.2, 1.2)}


class Promise(NamedTuple):
    """A figure must be >= or <= `must`, better `aim`; sense "" where nothing is promised."""

    sense: str = ""
    must: float | None = None
    aim: float | None = None


Make = Callable[["Kind", str, int], Campaign]
Fields = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """One kind of campaign.

    Attributes
    ----------
    make : callable
        Kind, boundary and seed to the campaign. A seed means another bench and other noise for
        every kind and boundary, so that all rows are independent; effects that the bench cannot
        show are drawn again.
    asks : dict
        A fact of `figures.FACTS` to what is promised of it.
    looks : tuple of int
        Numbers of trials at which a growing campaign is looked at; at its end alone where empty.
    """

    name: str
    group: str
    make: Make
    asks: Mapping[str, Promise] = field(default_factory=dict)
    boundaries: tuple[str, ...] = forms.BOUNDARIES
    looks: tuple[int, ...] = ()


def draw(kind: str, boundary: str, seed: int) -> Campaign:
    """The campaign of a seed: which effect, how strong, on which design."""
    return KINDS[kind].make(KINDS[kind], boundary, seed)


def chosen(names: str) -> tuple[str, ...]:
    """Kinds by name or by group, comma separated.

    Raises
    ------
    argparse.ArgumentTypeError
        A name is neither.
    """
    wanted = names.split(",")
    groups = dict.fromkeys(k.group for k in KINDS.values())
    for name in wanted:
        if name not in KINDS and name not in groups:
            raise argparse.ArgumentTypeError(
                f"{name}: no kind ({', '.join(KINDS)}), no group ({', '.join(groups)})"
            )
    return tuple(
        dict.fromkeys(k.name for n in wanted for k in KINDS.values() if n in (k.name, k.group))
    )


def _common(seed: int) -> Fields:
    """Fields that the seed's thirds decide, since three boundaries take three seeds in turn."""
    return {"realism": bool(seed // 3 % 2), "foreign": seed // 3 % 3 == 2}


def _records(kind: Kind, boundary: str, seed: int) -> Campaign:
    """Campaigns of load-cell records."""
    rng = stream(seed, "draw", kind.name, boundary)
    own = int(rng.integers(2**40))
    design = str(rng.choice(["from_one", "percent_diameter", "mm"], p=[0.5, 0.35, 0.15]))
    common = {"boundary": boundary, "design": design, **_common(seed)}
    if kind.name == "within":
        return simulate(Spec(**common, sink=_between(rng, 0.002, 0.02)), own)
    if kind.name == "two":
        return two_effects(rng, common, own)
    if kind.name in RHO:
        return _with_one(rng, forms.names(boundary), *RHO[kind.name], common, own)
    plain = {**common, "foreign": False}
    if kind.name == "null":
        return simulate(Spec(**plain), own)
    low, high = (0.2, STRONG) if rng.random() < 0.5 else (STRONG, 1.0)
    effect = str(rng.choice(list(forms.UNNAMED))), float(rng.uniform(low, high))
    return simulate(Spec(**plain, effects=(effect,)), own)


def two_effects(
    rng: np.random.Generator, fields: Fields, seed: int, scale: float = 1.0, least: float = 0.1
) -> Campaign:
    """Two effects, the weaker of rho 0.2 to 0.4 times `scale`; with the other in the model it keeps
    rho `least`: below, nothing could distinguish them.
    """
    names = [str(n) for n in rng.permutation(forms.names(fields["boundary"]))]
    pairs = list(itertools.combinations(names, 2))
    for i in rng.permutation(len(pairs)):
        rho = scale * float(rng.uniform(0.2, STRONG))
        with contextlib.suppress(Unreachable):
            both = zip(pairs[i], (rho, rho * float(rng.uniform(1, 2))), strict=True)
            campaign = simulate(Spec(**fields, effects=tuple(both)), seed)
            if min(campaign.truth.rho_beside.values()) >= least:
                return campaign
    raise Unreachable("any pair", 0.2, 0.0)


def _with_one(
    rng: np.random.Generator,
    among: tuple[str, ...],
    low: float,
    high: float,
    fields: Fields,
    seed: int,
) -> Campaign:
    """A campaign with one of these effects, its strength log-uniform, as far as the bench can show
    it.
    """
    for name in (str(n) for n in rng.permutation(among)):
        try:
            return simulate(Spec(**fields, effects=((name, _between(rng, low, high)),)), seed)
        except Unreachable as limit:
            if limit.most > 1.1 * low:
                rho = _between(rng, low, min(high, limit.most))
                return simulate(Spec(**fields, effects=((name, rho),)), seed)
    raise Unreachable("any effect", low, 0.0)


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def trials(
    fields: Fields | Callable[[np.random.Generator], Fields],
    kind: Kind,
    boundary: str,
    seed: int,
    *,
    rho: tuple[float, float] = (0.3, 1.0),
    among: tuple[str, ...] | None = None,
    always: bool = False,
) -> Campaign:
    """Campaigns of trials without records: empty and with one effect in turns; empty too where no
    bench shows any `among` those.
    """
    rng = stream(seed, "draw", kind.name, boundary)
    own = int(rng.integers(2**40))
    given = {"boundary": boundary, "errors": Errors(), "visits": int(rng.choice([5, 15]))}
    given |= {**_common(seed), "realism": False}
    given |= fields(rng) if callable(fields) else fields
    if always or seed // 3 % 2:
        names = tuple(n for n in among or forms.NAMED if boundary in forms.form(n, False).most)
        for bench in range(own, own + (20 if always else 1)):
            with contextlib.suppress(Unreachable):
                return _with_one(rng, names, *rho, given, bench)
        if always:
            raise Unreachable(kind.name, rho[0], 0.0)
    return simulate(Spec(**given), own)


COVERED = Promise(">=", 0.87, 0.90)
SOUND = {"null_claimed": Promise("<=", 0.05, 0.05), "covered": COVERED}
UNNAMED_UNDER = {"null_named": Promise("<=", 0.03, 0.01), "covered": COVERED}


def _kind(
    group: str,
    name: str,
    fields: Fields | Callable[[np.random.Generator], Fields],
    asks: Mapping[str, Promise] = SOUND,
    boundaries: tuple[str, ...] = forms.BOUNDARIES,
    looks: tuple[int, ...] = (),
    **how: Any,
) -> Kind:
    make = partial(trials, fields, **how)
    return Kind(name=name, group=group, make=make, asks=asks, boundaries=boundaries, looks=looks)


def _violation(name: str, asks: Mapping[str, Promise] = SOUND, **errors: float) -> Kind:
    return _kind("violations", name, {"errors": Errors(**errors)}, asks)


def _design(name: str, boundaries: tuple[str, ...] = forms.BOUNDARIES, **fields: Any) -> Kind:
    return _kind("designs", name, fields, boundaries=boundaries)


def _inputs(
    name: str, boundaries: tuple[str, ...] = forms.BOUNDARIES, **shared: float
) -> tuple[Kind, Kind]:
    """Stated, where the interval must hold the truth, and not, where nothing can be asked."""
    fields = {"shared": Shared(**shared), "visits": 5}
    return (
        _kind("inputs", f"{name}_declared", {**fields, "declared": True}, SOUND, boundaries),
        _kind("inputs", f"{name}_undeclared", fields, {}, boundaries),
    )


def random_gain(rng: np.random.Generator) -> Fields:
    """Half walk at random, half keep to 20 to 400 trials; 0.03 to 0.3 % rms."""
    trials = np.inf if rng.random() < 0.5 else _between(rng, 20, 400)
    return {"errors": Errors(wander=_between(rng, 3e-4, 3e-3), trials=trials)}


def _table(rng: np.random.Generator) -> Fields:
    """15 to 45 cells, each once."""
    throttles = int(rng.integers(3, 6))
    distances = int(rng.integers(5, 45 // throttles + 1))
    return {
        "errors": Errors(table=_between(rng, 0.004, 0.03)),
        "visits": 1,
        "sessions": 1,
        "order": "swept",
        "distances": distances,
        "throttles": tuple(np.linspace(0.3, 0.9, throttles).round(3).tolist()),
    }


#: Effects that a table of distances and throttles can show.
TABULAR = (
    *(
        name
        for name, (own, _) in forms.NAMED.items()
        if own.place in ("height", "ratio") and name not in ("approach_backlash", "tilt")
    ),
    *("room_recirculation", "zero_offset", "cell_nonlinearity", "tether_stiffness"),
)
RIGHT = {**SOUND, "named_right": Promise(">=", 0.8, 0.9)}
NAMELESS = {"given_a_name": Promise("<=", 0.03, 0.01), "covered": Promise(">=", 0.82, 0.88)}
LOOKS = tuple(int(4 * np.round(n / 4)) for n in np.linspace(160, 1200, 20))
KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        *(
            Kind(name=n, group="records", make=_records)
            for n in ("null", "weak", "one", "two", "outside", "within")
        ),
        _violation("t3", tails=3),
        _violation("noisier_far", far=3),
        _violation("noisier_near", near=3),
        _violation("noisier_sessions", sessions=0.5),
        _violation("dropout", lost=0.25, lost_sessions=1),
        _violation("outliers", outliers=0.015),
        _violation("bad_visit", bad_visit=7),
        _violation("rail", {"covered": COVERED}, rail=0.03),
        *(
            _violation(f"ar_{100 * r:.0f}", UNNAMED_UNDER if r >= 0.9 else SOUND, correlation=r)
            for r in (0.5, 0.8, 0.9, 0.95, 0.97)
        ),
        _kind("violations", "wander", random_gain, UNNAMED_UNDER),
        _design("large_rotor", radius_m=0.06),
        _design("two_throttles", throttles=(THROTTLES[1], THROTTLES[3])),
        _design("one_session", sessions=1),
        _design("swept", order="swept"),
        _design("eight_stations", distances=8, sessions=4),
        _design("nine_visits", distances=9, visits=1, sessions=1, throttles=EIGHT_THROTTLES),
        _design("trials_48", distances=6, visits=2, sessions=1),
        _design("trials_96", distances=8, visits=3, sessions=2),
        _design("trials_160", distances=10, visits=4, sessions=4),
        _design("trials_480", distances=12, visits=10, sessions=4),
        _design("trials_3840", visits=48, sessions=12),
        _design("scattered", order="scattered", visits=5),
        # at the ceiling's nearest station half a millimetre is a fifth of the distance
        _design("shaky_heights", boundaries=("ground", "sidewall"), height_m=5e-4),
        *_inputs("radius", rotor_radius=0.01),
        *_inputs("spacing", boundaries=("ground",), spacing_m=5e-4),
        *_inputs("datum", datum_m=2e-4),
        _kind(
            "experiments",
            "experiments",
            {"experiments": True},
            RIGHT,
            among=tuple(forms.EXPERIMENTS),
        ),
        _kind(
            "tables",
            "table",
            _table,
            {"undiagnosed": Promise("<=", 0.0, 0.0), **SOUND},
            rho=(1.0, 3.0),
            among=TABULAR,
        ),
        _kind(
            "growing",
            "growing",
            {"visits": 15},
            {"null_claimed": Promise("<=", 0.05, 0.05)},
            looks=LOOKS,
            rho=(0.3, 0.6),
        ),
        *(
            _kind(
                "strange",
                name,
                {},
                NAMELESS,
                tuple(form.most),
                rho=(STRONG, 1.0),
                among=(name,),
                always=True,
            )
            for name, form in forms.STRANGE.items()
        ),
    )
}
