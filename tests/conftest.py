"""One BLAS thread for every test process: small fits are slowed down many times by threads that wait for each other. And the demo, run once."""

import fcntl
import os
from pathlib import Path

import pytest
from click.testing import CliRunner

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the demo has run: once, whichever process asks first; the others wait for it. Not to be written."""
    from nearlift.cli import main

    own = tmp_path_factory.getbasetemp()
    out = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "the-demo"
    out.mkdir(exist_ok=True)
    with (out / ".waiting").open("w") as turn:
        fcntl.flock(turn, fcntl.LOCK_EX)
        if not (out / ".done").exists():
            found = CliRunner().invoke(main, ["demo", "--out", str(out), "-q"])
            assert (found.exit_code, found.output) == (0, "")
            (out / ".done").touch()
    return out
