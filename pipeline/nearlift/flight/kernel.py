"""Compiled integration of flights in dimensionless form (the paper's Eq. 6, extended).

    z'' = s [ max(0, u)^2 R(z) (1 + droop t/T) + noise w - 1 ]
    u = alpha (z - z0) + beta z' + gamma I + delta,     I' = z - z0

Lengths in rotor radii, times in sqrt(r/g), forces in weights. s is +1 above a ground and -1 below a
ceiling, where z is measured downwards. R(z) is L / L_inf by table; w is held for `hold`, of which
the step is a whole part. A flight ends when z <= contact, by Runge-Kutta also between steps. u is
limited to the range of the motors.

All settings meet the same gusts. They are advanced together, so that the processor works on several
while each waits for its table. A crashed setting leaves the list. Arrays are flat and every part of
the state is a scalar. A slice of an array in the loop would cost four times as much as the step.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from nearlift.compiler import compiled

#: Nodes of every table of L / L_inf.
NODES = 2049
#: Rows of the array of settings.
Z0, ALPHA, BETA, GAMMA, DELTA, NOISE, SIGN, DROOP, CONTACT, MOST = range(10)


@partial(compiled, inline="always")
def push(x: Any, v: Any, lag: Any, total: Any, law: Any, curve: Any) -> Any:
    """Acceleration away from the boundary, in g.

    `x` is height in table steps from the table's lower end, `lag` is z - z0. `law` holds alpha,
    beta, gamma and delta, the largest u, lift and load with the boundary's sign, and where the
    table begins. The table holds value and change of each step, and is constant beyond its ends.
    """
    alpha, beta, gamma, delta, most, lift, load, base = law
    u = min(max(alpha * lag + beta * v + gamma * total + delta, 0.0), most)
    x = min(max(x, 0.0), float(NODES - 1))
    i = int(x)
    at = base + 2 * i
    return u * u * lift * (curve[at] + (x - i) * curve[at + 1]) + load


@compiled
def fly(
    gusts: Any, ended: Any, track: Any,
    per_hold: Any, dt: Any, runge_kutta: Any, settings: Any, which: Any, curves: Any, low: Any,
    per: Any,
) -> None:  # fmt: skip
    """Fly through gusts (flights, holds) with all settings.

    `ended[s, f]` becomes the hold in which setting s crashed in flight f, or -1. `settings` is
    (10, n), `which` the start of each one's table, `curves` all tables in one row, `low` their
    lower end, `per` their nodes per radius. Where `track` (n, holds + 1) is not empty, it takes
    the heights of the last flight at the end of every hold. Without `runge_kutta` the scheme is
    explicit Euler, the paper's.
    """
    n = settings.shape[1]
    z0, alpha, beta, gamma = settings[Z0], settings[ALPHA], settings[BETA], settings[GAMMA]
    delta, noise, sign = settings[DELTA], settings[NOISE], settings[SIGN]
    droop, contact, most = settings[DROOP], settings[CONTACT], settings[MOST]
    keep_track = track.shape[0] > 0
    holds = gusts.shape[1]
    z, v, total = np.empty(n), np.empty(n), np.empty(n)
    active = np.empty(n, np.int64)
    half, sixth = 0.5 * dt, dt / 6.0
    for f in range(gusts.shape[0]):
        for s in range(n):
            z[s], v[s], total[s], active[s], ended[s, f] = z0[s], 0.0, 0.0, s, -1
            if keep_track:
                track[s, 0] = z0[s]
        left = n
        for k in range(holds):
            kept = 0
            passed = (k + 0.5) / holds
            gust = gusts[f, k]
            for j in range(left):
                s = active[j]
                x, w, i = z[s], v[s], total[s]
                here, floor, side = z0[s], contact[s], sign[s]
                lift = side * (1.0 + droop[s] * passed)
                load = side * (noise[s] * gust - 1.0)
                law = (alpha[s], beta[s], gamma[s], delta[s], most[s], lift, load, which[s])
                crashed = False
                for _ in range(per_hold):
                    q = (x - low) * per
                    g = x - here
                    from_x, before = x, w
                    if runge_kutta:
                        a1 = push(q, w, g, i, law, curves)
                        v2 = w + half * a1
                        g2 = g + half * w
                        a2 = push(q + half * w * per, v2, g2, i + half * g, law, curves)
                        v3 = w + half * a2
                        g3 = g + half * v2
                        a3 = push(q + half * v2 * per, v3, g3, i + half * g2, law, curves)
                        v4 = w + dt * a3
                        g4 = g + dt * v3
                        a4 = push(q + dt * v3 * per, v4, g4, i + dt * g3, law, curves)
                        x += sixth * (w + 2.0 * (v2 + v3) + v4)
                        i += sixth * (g + 2.0 * (g2 + g3) + g4)
                        w += sixth * (a1 + 2.0 * (a2 + a3) + a4)
                    else:
                        a1 = push(q, w, g, i, law, curves)
                        i += dt * g
                        x += dt * w
                        w += dt * a1
                    # approximate lowest point within the step, on the cubic through its ends
                    dip = x
                    if runge_kutta and before < 0.0 < w:
                        p = before / (before - w)
                        r = 1.0 - p
                        dip = r * r * (from_x * (1.0 + 2.0 * p) + p * dt * before)
                        dip += p * p * (x * (3.0 - 2.0 * p) - r * dt * w)
                    if min(x, dip) <= floor:
                        crashed = True
                        break
                if keep_track:
                    track[s, k + 1] = x
                if crashed:
                    ended[s, f] = k
                else:
                    z[s], v[s], total[s] = x, w, i
                    active[kept] = s
                    kept += 1
            left = kept
            if left == 0:
                break
