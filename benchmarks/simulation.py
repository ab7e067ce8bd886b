"""Steps of the paper's Fig. 6 on one thread, beside the same simulation in scalar C compiled here with -O3.

    python benchmarks/simulation.py [--flights 200] [--rounds 3]

All contestants fly the paper's settings (ground and ceiling, no model and five powers, explicit Euler, 0.1 s, 120 s) and stop a flight
when it crashes. "C" draws its normals per flight and setting (xoshiro256+ and Marsaglia's polar method) and evaluates the lift ratio
by formula; "C, table" interpolates the same table that nearlift does. "nearlift, gusts of its own" gives every setting its own
gusts, as C does; "nearlift" lets all settings of a boundary meet the same gusts, as the stage does. Times are of flying alone.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from nearlift import catalogue
from nearlift.simulation import groups, presets
from nearlift.simulation.curve import tabulate
from nearlift.simulation.flight import Plan, Setting, fly

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
    struct timespec a, b;
    clock_gettime(CLOCK_MONOTONIC, &a);
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
    printf("%ld %ld %.9f\n", steps, crashes, (b.tv_sec - a.tv_sec) + 1e-9 * (b.tv_nsec - a.tv_nsec));
    return 0;
}
"""
Contest = Callable[[], tuple[float, int, int]]


def plans() -> list[Plan]:
    """The paper's settings, a plan for each boundary."""
    preset = presets.preset("paper")
    found = []
    for boundary, name in presets.MODELS.items():
        model = catalogue.model(name)
        known = {n: presets.GEOMETRY[n] for n in model.needs}
        curves = tabulate([lambda z, k=k, m=model, known=known: m(z, **known) ** k for k in presets.EXPONENTS], presets.BOUND_Z_HAT)
        own = groups.of(preset.craft, preset.gains(boundary), preset.disturbance, preset.duration_s)
        settings = [Setting(target_z_hat=float(z), groups=own, curve=c) for c in range(len(presets.EXPONENTS)) for z in presets.TARGETS[boundary]]
        found.append(Plan(boundary=boundary, settings=settings, curves=curves, scheme="euler", steps_per_hold=1))
    return found


def contest_nearlift(flights: int, common: bool) -> tuple[float, int, int]:
    """Seconds, steps and crashes of one run."""
    steps = crashes = 0
    spent = 0.0
    for plan in plans():
        start = time.perf_counter()
        ended = fly(replace(plan, common=common), flights, 1)
        spent += time.perf_counter() - start
        steps += int(np.where(ended < 0, plan.holds, ended + 1).sum())
        crashes += int((ended >= 0).sum())
    return spent, steps, crashes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=3)
    given, _ = parser.parse_known_args()
    compiler = shutil.which("gcc") or shutil.which("cc")
    with tempfile.TemporaryDirectory() as folder:
        contestants: dict[str, Contest] = {}
        if compiler:
            (Path(folder) / "peer.c").write_text(SOURCE)
            subprocess.run([compiler, "-O3", "-march=native", "-o", "peer", "peer.c", "-lm"], cwd=folder, check=True)

            def contest_c(table: int) -> tuple[float, int, int]:
                told = subprocess.run([f"{folder}/peer", str(given.flights), str(table)], check=True, capture_output=True, text=True).stdout.split()
                return float(told[2]), int(told[0]), int(told[1])

            contestants |= {"C": lambda: contest_c(0), "C, table": lambda: contest_c(1)}
        else:
            print("no C compiler on this machine: nearlift alone")
        contestants |= {
            "nearlift, gusts of its own": lambda: contest_nearlift(given.flights, common=False),
            "nearlift": lambda: contest_nearlift(given.flights, common=True),
        }
        # the first call compiles
        contest_nearlift(2, common=True)
        runs: dict[str, list[tuple[float, int, int]]] = {name: [] for name in contestants}
        for _ in range(given.rounds):
            for name, contest in contestants.items():
                runs[name].append(contest())
    per_step = {name: min(1e9 * t / n for t, n, _ in own) for name, own in runs.items()}
    reference = per_step.get("C", next(iter(per_step.values())))
    print(f"{given.flights} flights a setting, {runs['nearlift'][0][1] / 1e6:.0f} M steps, one thread, best of {given.rounds}")
    for name, ns in per_step.items():
        _, steps, crashes = runs[name][0]
        rates = f"{1e3 / ns:6.1f} M steps/s   {ns:6.2f} ns = {ns / reference:5.2f} x C"
        print(f"{name:28s}{rates}   {crashes} crashes in {steps / 1e6:.1f} M steps")


if __name__ == "__main__":
    main()
