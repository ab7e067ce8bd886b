"""Steps of the paper's Fig. 6 on one thread, compared with the same simulation in scalar C.

All contestants fly the paper's settings (ground and ceiling, no model and five powers, explicit
Euler, 0.1 s, 120 s) and stop a flight when it crashes. C is compiled here with -O3. "C" draws its
normals per flight and setting (xoshiro256+ and Marsaglia's polar method) and evaluates the lift
ratio by formula; "C, table" interpolates the same table that nearlift does. In nearlift all
settings of a boundary meet the same gusts. Times are of flying alone.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from benchmarks import _compiled
from benchmarks.harness import Bench, Contestant, Target

SOURCE = r"""
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
static uint64_t s[4];
static inline uint64_t rotl(uint64_t x, int k) { return (x << k) | (x >> (64 - k)); }
static inline double uniform(void) {
    const uint64_t r = s[0] + s[3], t = s[1] << 17;
    s[2] ^= s[0]; s[3] ^= s[1]; s[1] ^= s[2]; s[0] ^= s[3]; s[2] ^= t; s[3] = rotl(s[3], 45);
    return (r >> 11) * 0x1.0p-53;
}
static double spare; static int has;
static inline double normal(void) {
    double u, v, q;
    if (has) { has = 0; return spare; }
    do { u = 2 * uniform() - 1; v = 2 * uniform() - 1; q = u * u + v * v; } while (q >= 1 || q == 0);
    q = sqrt(-2 * log(q) / q); spare = v * q; has = 1; return u * q;
}
#define N 2049
static double table[N];
static inline double model(int ceiling, double z) {
    if (z < 0.5) z = 0.5;
    if (ceiling) return 0.5 + 0.5 * sqrt(1 + 0.125 / (z * z));
    const double d2 = (90.0 / 23) * (90.0 / 23), a = d2 + 4 * z * z, b = 2 * d2 + 4 * z * z;
    return 1 / (1 - 1 / (16 * z * z) - z / (a * sqrt(a)) - z / (2 * b * sqrt(b)) - 4 * z / (b * sqrt(b)));
}
static inline double looked_up(double z) {
    double x = (z - 0.5) * ((N - 1) / 15.5);
    x = x < 0 ? 0 : x > N - 1.001 ? N - 1.001 : x;
    const int i = (int)x;
    return table[i] + (x - i) * (table[i + 1] - table[i]);
}
int main(int argc, char **argv) {
    const int flights = atoi(argv[1]), use_table = atoi(argv[2]);
    const double r = 0.023, m = 0.027, g = 9.8, K = 4 * 1.6 * 1.2 * r * r * r * r, powers[6] = {0, 0.6, 0.8, 1, 1.2, 1.4};
    long steps = 0, crashes = 0;
    for (int i = 0; i < 4; i++) s[i] = 0x9E3779B97F4A7C15ull * (i + 1);
    struct timespec a, b, c, d;
    clock_gettime(CLOCK_MONOTONIC, &a);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &c);
    for (int ceiling = 0; ceiling < 2; ceiling++)
        for (int p = 0; p < 6; p++) {
            const double k = powers[p], side = ceiling ? -1 : 1;
            for (int i = 0; i < N; i++) table[i] = pow(model(ceiling, 0.5 + 15.5 * i / (N - 1)), k);
            const int targets = ceiling ? 21 : 17;
            for (int j = 0; j < targets; j++) {
                const double z0 = (ceiling ? 0.8 : 0.4) + 0.1 * j, f0 = sqrt(m * g / (K * pow(model(ceiling, z0), k)));
                for (int f = 0; f < flights; f++) {
                    double z = z0 * r, v = 0, total = 0;
                    for (int n = 0; n < 1200; n++) {
                        double u = f0 - side * (316 * (z - z0 * r) + 316 * v + 31.6 * total);
                        if (u < 0) u = 0;
                        const double plain = use_table ? looked_up(z / r) : k == 0 ? 1 : model(ceiling, z / r);
                        const double ratio = use_table || k == 0 || k == 1 ? plain : pow(plain, k);
                        const double acc = side * (K * u * u * ratio + 0.015 * normal() - m * g) / m;
                        total += 0.1 * (z - z0 * r); z += 0.1 * v; v += 0.1 * acc; steps++;
                        if (z <= 0) { crashes++; break; }
                    }
                }
            }
        }
    clock_gettime(CLOCK_MONOTONIC, &b);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &d);
    const double wall = (b.tv_sec - a.tv_sec) + 1e-9 * (b.tv_nsec - a.tv_nsec), cpu = (d.tv_sec - c.tv_sec) + 1e-9 * (d.tv_nsec - c.tv_nsec);
    printf("{\"wall_s\": %.9f, \"cpu_s\": %.9f, \"ns a step\": %.3f, \"crashes\": %ld}\n", wall, cpu, 1e9 * wall / steps, crashes);
    return 0;
}
"""
FLIGHTS = "simulation-flights"


def plans() -> list[Any]:
    """The paper's flights at each boundary: how, curves and set-points."""
    from nearlift.flight import paper

    return [
        (
            paper.simulation("paper", boundary, 2, 1),
            paper.scaled_curves(boundary, paper.EXPONENTS),
            paper.TARGETS[boundary],
        )
        for boundary in paper.MODELS
    ]


def prepare(data: Path, quick: bool) -> str:
    flights = 20 if quick else 60
    (data / FLIGHTS).write_text(str(flights))
    _compiled.program(data, "simulation-peer", SOURCE)
    return (
        f"228 settings, explicit Euler at 0.1 s, flights that end with a crash, {flights} a"
        " setting; one thread, time of flying alone."
    )


def nearlift(data: Path) -> dict[str, Any]:
    """Fly, after a first flight that loads the compiled loop."""
    from dataclasses import replace

    import numpy as np

    steps = crashes = 0
    wall = cpu = 0.0
    flights = int((data / FLIGHTS).read_text())
    for how, curves, targets in plans():
        rows = np.arange(len(curves.values))[:, None]
        how.ended(curves, targets, rows)
        begun = time.perf_counter(), time.process_time()
        ended = replace(how, flights=flights).ended(curves, targets, rows)
        wall, cpu = wall + time.perf_counter() - begun[0], cpu + time.process_time() - begun[1]
        steps += int(np.where(ended < 0, how.holds, ended + 1).sum())
        crashes += int((ended >= 0).sum())
    return {"wall_s": wall, "cpu_s": cpu, "ns a step": 1e9 * wall / steps, "crashes": crashes}


def c(data: Path, table: int) -> list[str]:
    return [str(data / "simulation-peer"), (data / FLIGHTS).read_text(), str(table)]


PEERS = (
    Contestant(name="c", title="C, the ratio by formula", command=lambda data: c(data, 0)),
    Contestant(
        name="c-table", title="C, the ratio by nearlift's table", command=lambda data: c(data, 1)
    ),
)
BENCH = Bench(
    title="Flights of the paper's Fig. 6",
    prepare=prepare,
    one="c" if _compiled.compiler() else "nearlift",
    contestants=(
        *(PEERS if _compiled.compiler() else ()),
        Contestant(name="nearlift", title="nearlift, as the stage does", run=nearlift),
    ),
    targets=(
        Target(
            work="simulation on one thread over scalar C",
            ours="nearlift",
            peer="c",
            quantity="cpu_s",
            must=1.0,
            aim=0.5,
        ),
        Target(
            work="simulation on one thread over scalar C",
            ours="nearlift",
            peer="c",
            must=1.0,
            aim=0.5,
        ),
    ),
    note=(
        "The gain is that of common gusts, made once, and of settings advanced side by side; a"
        " single setting flown by itself has neither."
    ),
)
