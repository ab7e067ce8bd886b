"""The compiled loop: flights in dimensionless form (Eq. 6 of the paper, with what it leaves out),
many settings at once.

    z'' = s [ max(0, u)^2 R(z) (1 + droop t/T) + noise w - 1 ],     u = alpha (z - z0) + beta z' +
    gamma I + delta,     I' = z - z0

Lengths in rotor radii, times in sqrt(r/g), forces in weights. s is +1 above a ground and -1 below a
ceiling, where z is measured downwards; R(z) is L / L_inf by table; w is held for `hold`, of which
the step is a whole part. A flight ends when z <= contact.

One flight's gusts are made once and serve every setting, unless each is to have its own; the
settings are advanced side by side, so that the processor works on several while each waits for its
own table. A setting that has crashed leaves the list. Arrays are flat and every part of the state
is a number of its own: a slice of an array in the loop costs four times what the step does.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.compiler import compiled
from nearlift.flight.simulation.stream import GOLDEN, U, begin, fill, normal

#: Columns of a setting.
Z0, ALPHA, BETA, GAMMA, DELTA, NOISE, SIGN, DROOP, CONTACT = range(9)
WIDTH = 9
#: Explicit Euler (position takes the old velocity, as the paper does), semi-implicit Euler (the new
#: one), Runge-Kutta of order 4.
SCHEMES = {"euler": 0, "semi-implicit": 1, "rk4": 2}


def _push(x: Any, v: Any, lag: Any, total: Any, law: Any, curve: Any) -> Any:
    """Acceleration away from the boundary, in g.

    `x` is height in steps of the table from its lower end, `lag` is z - z0. `law` holds alpha,
    beta, gamma and delta, lift and load with the boundary's sign, and where the table begins. The
    table holds value and slope of each step; beyond either end L / L_inf is constant.
    """
    alpha, beta, gamma, delta, lift, load, base = law
    u = max(alpha * lag + beta * v + gamma * total + delta, 0.0)
    x = min(max(x, 0.0), float(NODES - 1))
    i = int(x)
    at = base + 2 * i
    return u * u * lift * (curve[at] + (x - i) * curve[at + 1]) + load


#: Nodes of every table of L / L_inf, equally spaced in z.
NODES = 2049
push = compiled(_push, inline="always")


def _fly(
    key: Any, first: Any, holds: Any, per_hold: Any, dt: Any, scheme: Any, memory: Any,
    settings: Any, which: Any, salts: Any, curves: Any, low: Any, per: Any, ended: Any, track: Any,
) -> None:  # fmt: skip
    """Fly a block of flights, the first of them number `first`, through all settings.

    `ended[s, f]` becomes the hold in which setting s crashed in flight f, or -1. `memory` is the
    gusts' correlation from hold to hold (0: white). `settings` is (WIDTH, n), `which` the table of
    each, `salts` what tells its gusts from the others' (empty: all meet the same), `curves` all
    tables in one row. Where `track` (n, holds + 1) is not empty, it takes the heights of the last
    flight flown, at the end of every hold.
    """
    n = settings.shape[1]
    z0, alpha, beta, gamma = settings[Z0], settings[ALPHA], settings[BETA], settings[GAMMA]
    delta, noise, sign = settings[DELTA], settings[NOISE], settings[SIGN]
    droop, contact = settings[DROOP], settings[CONTACT]
    keep_track = track.shape[0] > 0
    own = salts.size > 0
    gusts = np.zeros(holds)
    start, last = np.empty(salts.size, np.uint64), np.zeros(salts.size)
    z, v, total = np.empty(n), np.empty(n), np.empty(n)
    active = np.empty(n, np.int64)
    fresh = np.sqrt(1.0 - memory * memory)
    half, sixth = 0.5 * dt, dt / 6.0
    for f in range(ended.shape[1]):
        if own:
            for s in range(n):
                start[s] = begin(key, first + f, salts[s])
        else:
            fill(begin(key, first + f, U(0)), gusts)
            if memory > 0.0:
                for k in range(1, holds):
                    gusts[k] = memory * gusts[k - 1] + fresh * gusts[k]
        for s in range(n):
            z[s], v[s], total[s], active[s], ended[s, f] = z0[s], 0.0, 0.0, s, -1
            if keep_track:
                track[s, 0] = z0[s]
        left = n
        for k in range(holds):
            kept = 0
            passed = (k + 0.5) / holds
            gust = gusts[k]
            for j in range(left):
                s = active[j]
                if own:
                    gust = normal(start[s] + U(k) * GOLDEN)
                    if memory > 0.0:
                        last[s] = gust = memory * last[s] + fresh * gust if k > 0 else gust
                x, w, i = z[s], v[s], total[s]
                here, floor, side = z0[s], contact[s], sign[s]
                lift = side * (1.0 + droop[s] * passed)
                load = side * (noise[s] * gust - 1.0)
                law = (alpha[s], beta[s], gamma[s], delta[s], lift, load, which[s])
                crashed = False
                for _ in range(per_hold):
                    q = (x - low) * per
                    g = x - here
                    if scheme == 2:
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
                        if scheme == 1:
                            w += dt * a1
                            x += dt * w
                        else:
                            x += dt * w
                            w += dt * a1
                    if x <= floor:
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


fly = compiled(_fly)
