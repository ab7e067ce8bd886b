"""Where tasks run decides nothing but the time: order, results, refusals and bytes are the same."""

from __future__ import annotations

import concurrent.futures
import os
import socket
import sys
import threading
import time
from pathlib import Path

import pytest
from tests.calibration.streams import unordered

from nearlift import blas
from nearlift.errors import InputRefused, UsageError
from nearlift.run import graph
from nearlift.run.executors import SerialExecutor, open_executor, ordered
from nearlift.stages import ingest

from . import small_run

EXECUTORS = ["serial", "threads:2", "processes:2"]


def square(x: int) -> int:
    return x * x


def late_first(x: int) -> int:
    time.sleep(0.05 if x == 0 else 0.0)
    return x


def refuse_three(x: int) -> int:
    if x == 3:
        raise UsageError("three", "is refused")
    return x


@pytest.mark.parametrize("name", EXECUTORS[:2])
def test_results_come_in_the_order_of_the_tasks(name):
    with open_executor(name) as pool:
        assert list(ordered(pool, late_first, range(20))) == list(range(20))


def test_a_process_can_run_a_task():
    """With a function that a fresh interpreter can import; tests' own are not."""
    with open_executor("processes:2") as pool:
        assert list(ordered(pool, abs, range(-9, 9))) == [abs(x) for x in range(-9, 9)]


@pytest.mark.parametrize("name", EXECUTORS[:2])
def test_a_refusal_in_a_task_is_the_callers(name):
    with open_executor(name) as pool, pytest.raises(UsageError, match="three: is refused"):
        list(ordered(pool, refuse_three, range(20)))


def test_no_more_tasks_are_in_flight_than_asked():
    """Memory stays flat: specs are drawn only as results are taken."""
    drawn = []

    def specs():
        for x in range(100):
            drawn.append(x)
            yield x

    with open_executor("serial") as pool:
        results = ordered(pool, square, specs(), ahead=5)
        for taken in range(20):
            next(results)
            assert len(drawn) <= taken + 1 + 5
        results.close()


def test_what_waits_is_cancelled_when_the_caller_stops():
    started, gate = [], threading.Event()

    def task(x: int) -> int:
        started.append(x)
        if x:
            gate.wait(5)
        return x

    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        results = ordered(pool, task, range(8), ahead=8)
        assert next(results) == 0
        results.close()
        gate.set()
    assert len(started) < 8


@pytest.mark.parametrize("ahead", [1, 3, 64])
@pytest.mark.parametrize("name", EXECUTORS[:2])
def test_results_without_order_are_all_of_them(name, ahead):
    with open_executor(name) as pool:
        found = list(unordered(pool, late_first, range(20), ahead))
    assert sorted(found) == list(range(20))
    if name == "threads:2" and ahead > 1:
        assert found[0] != 0


def test_results_without_order_come_while_others_wait():
    """Whoever keeps each result loses little when the run is broken off; what has not begun is
    cancelled.
    """
    drawn = []

    def specs():
        for x in range(100):
            drawn.append(x)
            yield x

    with open_executor("serial") as pool:
        results = unordered(pool, square, specs())
        assert [next(results) for _ in range(3)] == [0, 1, 4]
        assert drawn == [0, 1, 2]
        results.close()
    with concurrent.futures.ThreadPoolExecutor(1) as one, pytest.raises(UsageError, match="three"):
        list(unordered(one, refuse_three, range(1000)))


def test_serial_carries_exceptions_in_the_future_but_lets_an_interrupt_through():
    pool = SerialExecutor()
    assert isinstance(pool.submit(refuse_three, 3).exception(), UsageError)

    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pool.submit(interrupt)


@pytest.mark.parametrize("text", ["gpu", "serial:2", "dask", "dask:", ""])
def test_an_executor_that_is_not_one_is_refused_with_those_that_are(text):
    with (
        pytest.raises(
            UsageError,
            match=r"is not an executor\n  use serial, threads:N, processes:N or dask:ADDRESS",
        ),
        open_executor(text),
    ):
        pass


@pytest.mark.parametrize("text", ["threads:0", "threads:-1", "processes:two", "threads:1.5"])
def test_a_number_of_workers_that_is_not_one_is_refused(text):
    with (
        pytest.raises(
            UsageError, match=rf"--executor: '{text}' names no number of workers\n  write threads:2"
        ),
        open_executor(text),
    ):
        pass


def test_without_a_number_there_are_as_many_workers_as_processors(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 3)
    with open_executor("threads") as pool:
        assert pool._max_workers == 3  # type: ignore[attr-defined]


@pytest.fixture(scope="module", params=["csv", "parquet"])
def campaign(request, tmp_path_factory) -> Path:
    return small_run.write(tmp_path_factory.mktemp("executors") / request.param, form=request.param)


def test_trials_are_the_same_bytes_wherever_they_were_reduced(campaign, tmp_path):
    found = {}
    for name in EXECUTORS:
        with open_executor(name) as pool:
            job = small_run.job(campaign, tmp_path / name.replace(":", ""), executor=pool)
            list(graph.run(job, (graph.stage("ingest"),)))
            found[name] = (job.processed / "trials.parquet").read_bytes()
    assert found["serial"] == found["threads:2"] == found["processes:2"]


def test_a_damaged_record_is_refused_alike_wherever_it_is_read(tmp_path):
    """The error crosses a process with where, what and remedy."""
    copy = small_run.write(tmp_path / "copy", form="parquet", visits=1)
    content = bytearray((copy / "records.parquet").read_bytes())
    content[len(content) // 2] ^= 1
    (copy / "records.parquet").write_bytes(bytes(content))
    told = []
    for name in EXECUTORS:
        with (
            open_executor(name) as pool,
            pytest.raises(Exception, match=r"records\.parquet") as refusal,
        ):
            ingest.run(small_run.job(copy, tmp_path / "out", executor=pool))
        told.append((type(refusal.value), str(refusal.value)))
    assert told[0] == told[1] == told[2]


DEADLY = """
import os, signal, time
from pathlib import Path

def square(spec):
    x, mark = spec
    with open(mark + ".calls", "a") as file:
        print(x, file=file)
    if x == 3 and not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.01)
    return x * x

def die(spec):
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def deadly(tmp_path, monkeypatch):
    """A module that fresh processes can import, whose tasks kill the process that runs them."""
    (tmp_path / "deadly_tasks.py").write_text(DEADLY)
    monkeypatch.syspath_prepend(tmp_path)
    import deadly_tasks

    yield deadly_tasks
    del sys.modules["deadly_tasks"]


def test_the_death_of_a_process_changes_no_result(deadly, tmp_path):
    specs = [(x, str(tmp_path / "died")) for x in range(12)]
    with open_executor("processes:2") as pool:
        assert list(ordered(pool, deadly.square, specs)) == [x * x for x in range(12)]
    assert (tmp_path / "died").exists()


def test_the_death_of_a_process_costs_its_own_task_alone(deadly, tmp_path):
    """Others, in other processes or waiting, run once: a long calibration loses one campaign's
    time, not all that is in flight.
    """
    specs = [(x, str(tmp_path / "died")) for x in range(12)]
    with open_executor("processes:2") as pool:
        assert sorted(unordered(pool, deadly.square, specs)) == [x * x for x in range(12)]
    assert sorted(map(int, (tmp_path / "died.calls").read_text().split())) == sorted(
        [*range(12), 3]
    )


def test_processes_have_one_thread_of_linear_algebra(monkeypatch):
    for name in blas.VARIABLES:
        monkeypatch.delenv(name, raising=False)
    with open_executor("processes:1") as pool:
        assert [pool.submit(os.getenv, name).result() for name in blas.VARIABLES] == ["1", "1", "1"]
    monkeypatch.setenv("OMP_NUM_THREADS", "4")
    with open_executor("processes:1") as pool:
        assert pool.submit(os.getenv, "OMP_NUM_THREADS").result() == "4"


def test_a_task_that_kills_every_process_is_refused(deadly):
    with (
        open_executor("processes:1") as pool,
        pytest.raises(
            InputRefused, match="--executor: a worker process died 3 times over one task"
        ),
    ):
        list(ordered(pool, deadly.die, [0]))


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:1", "127.0.0.1:port", "http://127.0.0.1:1", "silent"]
)
def test_a_scheduler_that_does_not_answer_is_told_as_such(address, monkeypatch):
    pytest.importorskip("distributed", reason="the extra nearlift[dask] is not installed")
    monkeypatch.setattr("nearlift.run.executors.ANSWER_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        # somebody listens, who is no scheduler
        address = address.replace("silent", f"tcp://127.0.0.1:{silent.getsockname()[1]}")
        with (
            pytest.raises(
                UsageError, match=f"no dask scheduler answers at '{address}'.*\\n  start one"
            ),
            open_executor(f"dask:{address}"),
        ):
            pass


def test_a_killed_worker_of_a_cluster_changes_no_result(cluster, deadly, tmp_path):
    address, workers = cluster
    specs = [(x, str(tmp_path / "died")) for x in range(40)]
    with open_executor(f"dask:{address}") as pool:
        assert list(ordered(pool, deadly.square, specs)) == [x * x for x in range(40)]
        dead = [w for w in workers if w.poll() is not None]
    assert (tmp_path / "died").exists()
    assert len(dead) == 1
