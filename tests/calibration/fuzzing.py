"""Run one target under atheris: ``python -m tests.calibration.fuzzing TARGET SECONDS CORPUS``; 2 s
and 512 MB per input, or it is a finding.

The slowest input so far is kept as ``CORPUS-slowest``, its time in ``CORPUS-slowest.txt``: the
fuzzer ends the process without a last word.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

#: Processor time of one input, s, and memory of the whole process, MB. The clock on the wall may
#: show more on a busy machine.
TIME_S, MEMORY_MB, WALL_S = 2.0, 512, 20


def main() -> None:
    import atheris

    # only what is ours is followed branch by branch
    with atheris.instrument_imports(include=["nearlift"]):
        from tests.calibration import targets

    target, seconds, corpus = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
    corpus.mkdir(parents=True, exist_ok=True)
    for i, seed in enumerate(targets.TARGETS[target][1]):
        (corpus / f"seed{i}").write_bytes(seed)
        # libraries are loaded, and kernels compiled, on first use: a second that belongs to no
        # input
        for content in (seed, seed[:-1], seed + b"\n,", seed.replace(b"5", b"x")):
            targets.once(target, content)
    targets.ready()
    slowest = 0.0

    def timed(data: bytes) -> None:
        nonlocal slowest
        start = time.process_time()
        targets.once(target, data)
        taken = time.process_time() - start
        if taken > slowest:
            slowest = taken
            Path(f"{corpus}-slowest").write_bytes(data)
            Path(f"{corpus}-slowest.txt").write_text(f"{taken:.6f}\n")
        if taken > TIME_S:
            raise TimeoutError(f"an input took {taken:.3g} s")

    limits = [
        f"-max_total_time={seconds}",
        f"-timeout={WALL_S}",
        f"-rss_limit_mb={MEMORY_MB}",
        "-max_len=4096",
    ]
    atheris.Setup(
        [sys.argv[0], *limits, f"-artifact_prefix={corpus}-", "-print_final_stats=1", str(corpus)],
        timed,
    )
    atheris.Fuzz()


if __name__ == "__main__":
    main()
