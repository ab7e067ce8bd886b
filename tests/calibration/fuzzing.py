"""Run one target under atheris: ``python -m tests.calibration.fuzzing TARGET SECONDS CORPUS``; 2 s and 512 MB per input, or it is a finding."""

from __future__ import annotations

import sys
from pathlib import Path


def main() -> None:
    import atheris

    # only what is ours is followed branch by branch
    with atheris.instrument_imports(include=["nearlift"]):
        from tests.calibration import targets

    target, seconds, corpus = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
    corpus.mkdir(parents=True, exist_ok=True)
    for i, seed in enumerate(targets.TARGETS[target][1]):
        (corpus / f"seed{i}").write_bytes(seed)
        # libraries are loaded, and kernels compiled, on first use: a second that belongs to no input
        for content in (seed, seed[:-1], seed + b"\n,", seed.replace(b"5", b"x")):
            targets.once(target, content)
    limits = [f"-max_total_time={seconds}", "-timeout=2", "-rss_limit_mb=512", "-max_len=4096", f"-artifact_prefix={corpus}-", "-print_final_stats=1"]
    atheris.Setup([sys.argv[0], *limits, str(corpus)], lambda data: targets.once(target, data))
    atheris.Fuzz()


if __name__ == "__main__":
    main()
