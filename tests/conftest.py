"""One BLAS thread for every test process: small fits are slowed down many times by threads that
wait for each other. And the demo, run once.
"""

import contextlib
import ctypes
import fcntl
import os
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import hypothesis
import pytest
import threadpoolctl
from click.testing import CliRunner

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
# a plugin may have brought numpy before the environment said so
threadpoolctl.threadpool_limits(1, "blas")

# how long an example takes says how busy the machine is
hypothesis.settings.register_profile(
    "untimed",
    deadline=None,
    max_examples=40,
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
    print_blob=True,
)
hypothesis.settings.load_profile("untimed")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--executor",
        default="serial",
        help="where simulated campaigns run: serial, threads:N, processes:N or dask:ADDRESS",
    )


def pytest_configure(config: pytest.Config) -> None:
    # tests run in a random order, but nothing else is drawn anew: a generator has the seed that its
    # test gives it
    config.option.randomly_reset_seed = False


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    # the demo takes longest, and while a process makes it the others have work of their own
    items.sort(key=lambda item: "demo" not in getattr(item, "fixturenames", ()))


@pytest.fixture(scope="module", autouse=True)
def _freed_memory_goes_back() -> Iterator[None]:
    """Between modules: the C library keeps what figures and fits have freed, and a process of the
    suite grew to 2 GB that nothing held.
    """
    yield
    with contextlib.suppress(AttributeError, OSError):  # only glibc has it
        ctypes.CDLL(None).malloc_trim(0)


Once = Callable[[str, Callable[[Path], None]], Path]


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    """A folder of that name which a function has filled: once, whichever process asks first; the
    others wait for it. Not to be written.
    """
    own = tmp_path_factory.getbasetemp()
    home = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own

    def made(name: str, make: Callable[[Path], None]) -> Path:
        out, done = home / name, home / f"{name}.done"
        with (home / f"{name}.lock").open("w") as turn:
            fcntl.flock(turn, fcntl.LOCK_EX)
            if not done.exists():
                shutil.rmtree(out, ignore_errors=True)
                out.mkdir()
                make(out)
                done.touch()
        return out

    return made


@pytest.fixture(scope="session")
def small_campaign(once: Once) -> Path:
    """The folder in which a small campaign, raw/, has run; its figures are not drawn. An hour old, as
    any lab's: digests of files that are younger than two seconds are not kept.
    """
    from tests.unit import small_run

    def run(out: Path) -> None:
        raw = small_run.write(out / "raw")
        for path in raw.rglob("*"):
            os.utime(path, (time.time() - 3600,) * 2)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("nearlift.report.figures.files.render", small_run.undrawn)
            found = small_run.nearlift("run", raw, "--out", out, "-q", "--executor", "serial")
        assert (found.exit_code, found.stdout, found.stderr) == (0, "", "")

    return once("the-small-campaign", run)


@pytest.fixture(scope="session")
def demo(once: Once) -> Path:
    """The folder in which the demo has run."""
    from nearlift.cli import main

    def run(out: Path) -> None:
        found = CliRunner().invoke(main, ["demo", "--out", str(out), "-q"])
        assert (found.exit_code, found.output) == (0, "")

    return once("the-demo", run)
