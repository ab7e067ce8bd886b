"""The quantity and unit that a heading states, and which channel is the force."""

from __future__ import annotations

import numpy as np
import pytest

from nearlift.onboarding import headings
from nearlift.readers.base import Channel


@pytest.mark.parametrize(
    ("columns", "force"),
    [
        ((("u1[N]", "N"), ("u2[N]", "N"), ("fz[mN]", "mN")), "fz[mN]"),
        ((("u1[N]", "N"), ("u2[N]", "N")), None),
        ((("motor 1 (N)", "N"), ("F", "N")), "F"),
        ((("setpoint", "N"), ("t", "s")), None),
        ((("Thrust target (gf)", "gf"), ("Thrust (gf)", "gf")), "Thrust (gf)"),
        ((("pwm", ""), ("vbat", "V"), ("thrust_g", "g")), "thrust_g"),
        # no telling which
        ((("fz1", "N"), ("fz2", "N")), None),
        ((("motor thrust (N)", "N"), ("rpm", "rpm")), "motor thrust (N)"),
    ],
)
def test_a_command_is_no_force_and_of_two_forces_none_is_picked(columns, force):
    channels = [Channel(name=name, unit=unit, values=np.arange(5.0)) for name, unit in columns]
    chosen = headings.force_channel(channels)
    assert (chosen and chosen.name) == force


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("vbat_V", ("vbat", "V")),
        ("Thrust (gf)", ("Thrust", "gf")),
        ("Thrust, gf", ("Thrust", "gf")),
        ("Kraft / N", ("Kraft", "N")),
        ("Zeit in s", ("Zeit", "s")),
        ("h/mm", ("h", "mm")),
        ("t/s", ("t", "s")),
        ("fz_n", ("fz", "N")),
        ("millis", ("millis", "ms")),
        # counts, and names that end like a unit by chance
        *((name, (name, "")) for name in ("sample_n", "m_1", "_s", "m/s", "Position x, y")),
    ],
)
def test_units_in_names(name, meant):
    assert headings.named(name) == meant


@pytest.mark.parametrize(
    ("heading", "meant"),
    [
        ("Battery V", ("supply", "")),
        ("vbat_V", ("supply", "V")),
        ("h/R", ("distance", "R")),
        ("h_over_R", ("distance", "R")),
        ("z/D", ("distance", "2 R")),
        ("Height above floor [mm]", ("distance", "mm")),
        ("Signal (us)", ("throttle", "us")),
        ("ESC throttle (%)", ("throttle", "percent")),
        ("duty_pct", ("throttle", "percent")),
        ("duty", ("throttle", "")),
        ("Max thrust (g)", ("", "")),
        ("Anzahl", ("n", "")),
        ("p (W)", ("power", "W")),
        ("p", ("", "")),
    ],
)
def test_columns_of_a_schedule_as_tables_call_them(heading, meant):
    assert headings.schedule_column(heading) == meant
