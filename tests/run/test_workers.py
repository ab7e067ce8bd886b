"""Executors change no result; what dies is reported; several campaigns end as each alone would."""

from __future__ import annotations

import concurrent.futures
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from tests.run.tasks import die, late_first, verdict, where
from tests.unit import small_run

from nearlift import blas, isolation
from nearlift.errors import InputRefused, UsageError
from nearlift.run import campaigns, engine
from nearlift.run.campaigns import run_campaigns
from nearlift.run.workers import (
    AUTO,
    LARGE,
    Processes,
    SerialExecutor,
    for_compiled_code,
    open_executor,
    ordered,
    shared,
)
from nearlift.stages import STAGES

FIRST = STAGES[:1]
THREADS = concurrent.futures.ThreadPoolExecutor


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    """Let fresh processes import the tasks: they get this process's path, but no current folder."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2])


@pytest.fixture
def worker():
    """One process."""
    with open_executor("processes:1") as pool:
        yield pool


@pytest.fixture
def program(tmp_path):
    """Run a program from a file of its own, as users do."""

    def run(code: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / "program.py").write_text(code)
        # coverage could not open its file where no file can be opened
        kept = {name: value for name, value in os.environ.items() if not name.startswith("COV")}
        how = {"env": kept, "timeout": 60, "check": False, "capture_output": True, "text": True}
        return subprocess.run([sys.executable, tmp_path / "program.py"], **how)

    return run


# ---- executors


@pytest.mark.parametrize("name", ["serial", "threads:2", "processes:2"])
def test_results_come_in_order(name):
    with open_executor(name) as pool:
        assert list(ordered(pool, late_first, range(12))) == list(range(12))


def test_this_process_takes_what_no_other_has_begun(worker):
    done = []
    answers = list(shared(worker, where, range(30), ahead=20, first=lambda: done.append(True)))
    assert [x for x, _ in answers] == list(range(30))
    assert len({pid for _, pid in answers}) == 2
    assert os.getpid() in {pid for _, pid in answers}
    assert done == [True]


def test_a_fault_here_is_raised_where_its_result_is_due(worker):
    results = shared(worker, int, ["1", "2", "x"])
    assert [next(results), next(results)] == [1, 2]
    with pytest.raises(ValueError, match="invalid literal"):
        next(results)


def test_compiled_code_runs_in_threads_of_this_process(worker):
    with for_compiled_code(worker) as threads:
        both = threading.Barrier(2, timeout=60)
        pids = list(threads.map(lambda _: (both.wait(), os.getpid())[1], range(2)))
    assert pids == [os.getpid()] * 2
    with open_executor("serial") as pool, for_compiled_code(pool) as same:
        assert same is pool


@pytest.mark.parametrize(
    ("size", "processors", "kind"),
    [(LARGE + 1, 8, Processes), (LARGE, 8, THREADS), (LARGE + 1, 1, THREADS)],
)
def test_large_records_are_worth_another_process(monkeypatch, size, processors, kind):
    monkeypatch.setattr(os, "cpu_count", lambda: processors)
    with open_executor(AUTO, size) as pool:
        assert isinstance(pool, kind)


def test_what_waits_is_cancelled_when_the_caller_stops():
    started, gate = [], threading.Event()

    def task(x):
        started.append(x)
        if x:
            gate.wait(5)
        return x

    with THREADS(1) as pool:
        results = ordered(pool, task, range(8), ahead=8)
        assert next(results) == 0
        results.close()
        gate.set()
    assert len(started) < 8


def test_serial_carries_faults_in_the_future_but_lets_an_interrupt_through():
    def interrupt():
        raise KeyboardInterrupt

    assert isinstance(SerialExecutor().submit(int, "x").exception(), ValueError)
    with pytest.raises(KeyboardInterrupt):
        SerialExecutor().submit(interrupt)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("gpu", r"is not an executor\n  use serial, threads:N, processes:N or dask:ADDRESS"),
        ("serial:2", "is not an executor"),
        ("dask:", "is not an executor"),
        ("dask:tcp://a:1", "takes whole campaigns"),
        ("threads:0", r"'threads:0' names no number of workers\n  write threads:2"),
        ("processes:two", "names no number"),
    ],
)
def test_an_executor_that_is_not_one_is_refused(text, what):
    with pytest.raises(UsageError, match=what), open_executor(text):
        pass


# ---- processes


def test_processes_import_nothing_from_the_current_folder_and_have_one_blas_thread(monkeypatch):
    names = (isolation.SAFE_PATH, *blas.VARIABLES)
    for name in names:
        monkeypatch.delenv(name, raising=False)
    with open_executor("processes:1") as pool:
        assert list(pool.map(os.getenv, names)) == ["1"] * 4
    assert isolation.SAFE_PATH not in os.environ


def test_an_interrupt_ends_what_processes_do():
    start = time.monotonic()

    def interrupted(pool):
        running = pool.submit(time.sleep, 600)
        while not running.running():
            time.sleep(0.01)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), open_executor("processes:1") as pool:
        interrupted(pool)
    assert time.monotonic() - start < 300


def test_tasks_that_were_taken_back_do_not_hide_that_a_worker_died(worker):
    tasks = [worker.submit(die, 0), *[worker.submit(where, i) for i in range(20)]]
    assert tasks[10].cancel()
    with pytest.raises(concurrent.futures.BrokenExecutor):
        tasks[20].result(timeout=60)
    worker.load(["json"])
    assert not worker.ready


def test_a_worker_never_hears_an_interrupt(worker):
    """Ctrl-C reaches a whole group, and a process that only begins would print a traceback."""
    task = worker.submit(where, 1)
    for _ in range(20):
        os.kill(next(iter(worker._processes)), signal.SIGINT)
        time.sleep(0.02)
    assert task.result(timeout=60)[0] == 1
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == set()


#: Large arguments do not fit into the pipe from which a dead worker no longer reads.
DYING = """
from nearlift.run.workers import open_executor

class Unreadable:
    def __reduce__(self):
        return int, ("x",)

if __name__ == "__main__":
    with open_executor("processes:1") as pool:
        tasks = [pool.submit(len, item) for item in (Unreadable(), *[bytes(1 << 22)] * 3)]
        tasks[-1].cancel()
        tasks[0].exception()
        raise SystemExit(7)
"""
KILLED = """
import os, signal
from nearlift.run.workers import open_executor
if __name__ == "__main__":
    with open_executor("processes:1") as pool:
        pool.submit(os.getpid).result()
        os.kill(os.getpid(), signal.SIGKILL)
"""
UNGUARDED = """
import os
from nearlift.run import workers

os.cpu_count = lambda: 2
with workers.open_executor(workers.AUTO, workers.LARGE + 1) as pool:
    print(type(pool).__name__, pool.submit(os.getpid).result() != os.getpid())
"""
#: No file can be opened when processes begin, or when the first of them does.
LIMITED = """
import os, resource
from nearlift.run import workers

def limit():
    free = os.dup(2)
    os.close(free)
    resource.setrlimit(resource.RLIMIT_NOFILE, (free, free))

import concurrent.futures.thread, multiprocessing.popen_spawn_posix, multiprocessing.queues
early = {}
early and limit()
with workers.open_executor("processes:1") as pool:
    early or limit()
    print(type(pool).__name__, pool.submit(os.getpid).result() == os.getpid())
"""


@pytest.mark.parametrize(
    ("code", "answer"),
    [
        (UNGUARDED, "Processes True"),
        (LIMITED.format(True), "SerialExecutor True"),
        (LIMITED.format(False), "Processes True"),
    ],
    ids=["program without a guard", "no semaphores", "no process"],
)
def test_where_processes_cannot_be_had_as_usual_tasks_still_run(program, code, answer):
    done = program(code)
    assert (done.stdout.strip(), done.stderr) == (answer, "")


def test_a_dead_worker_holds_nobody_up_and_a_killed_program_leaves_nothing(program):
    assert program(DYING).returncode == 7
    # the pipes end when the last process that holds them does
    done = program(KILLED)
    assert (done.returncode, done.stderr) == (-signal.SIGKILL, "")


# ---- stages


def test_trials_are_the_same_bytes_wherever_they_were_reduced(tmp_path):
    root, made = small_run.write(tmp_path / "raw", form="parquet", visits=1), set()
    for name in ("serial", "threads:2", "processes:2"):
        with open_executor(name) as pool:
            job = small_run.job(root, tmp_path / name.replace(":", ""), executor=pool)
            list(engine.run(job, FIRST))
            made.add((job.processed / "trials.parquet").read_bytes())
    assert len(made) == 1


def test_a_worker_that_dies_ends_the_stage_with_a_message(tmp_path, worker):
    stage = engine.Stage(
        name="dies", summary="dies", run=lambda job: list(job.executor.map(die, [0]))
    )
    root = small_run.write(tmp_path / "raw", visits=1)
    job = small_run.job(root, tmp_path / "out", executor=worker, stages=(stage,))
    with pytest.raises(InputRefused, match=r"--executor: a worker process died\n  use fewer"):
        list(engine.run(job))


# ---- several campaigns


@pytest.fixture
def two_campaigns(tmp_path):
    roots = [small_run.write(tmp_path / f"raw{i}", visits=1) / "campaign.toml" for i in range(2)]
    for i, file in enumerate(roots):
        file.write_text(file.read_text().replace(f'"{small_run.NAME}"', f'"c{i}"', 1))
    return [file.parent for file in roots]


@pytest.fixture
def ends(tmp_path):
    """How each campaign ends, products in one folder."""

    def run(roots, executor="serial", task=verdict, *more):
        return list(run_campaigns(roots, tmp_path / "out", FIRST, executor, 0, task, *more))

    return run


@pytest.mark.parametrize("executor", ["serial", "processes:2"])
def test_campaigns_end_as_each_alone_would(tmp_path, two_campaigns, ends, executor):
    one, two = two_campaigns
    (two / "trials.csv").unlink()
    nowhere = tmp_path / "nowhere"
    each = ends([one, two, nowhere], executor)
    assert [end.campaign for end in each][::2] == ["c0", str(nowhere)]
    assert [end.exit_code for end in each] == [0, 4, 2]
    assert (each[0].words, each[0].ran) == ("seen", ("ingest",))
    assert each[1].words.startswith("exit code 4: ")
    assert campaigns.most_serious(each) == 4
    assert ends([one])[0].words == "seen; up to date"
    assert ends([one], "serial", verdict, "ingest")[0].ran == ("ingest",)


def test_two_campaigns_of_one_name_or_with_a_dying_process_are_refused(two_campaigns, ends):
    with pytest.raises(UsageError, match="has the same name as"):
        ends([two_campaigns[0]] * 2)
    with pytest.raises(InputRefused, match="a worker process died; campaigns without a line"):
        ends(two_campaigns, "processes:1", die)


# ---- dask


@pytest.fixture
def cluster(tmp_path):
    """A scheduler and a worker, as processes."""
    distributed = pytest.importorskip("distributed", reason="nearlift[dask] is not installed")
    file, started = tmp_path / "scheduler.json", []

    def start(module, *words):
        command = [sys.executable, "-m", f"distributed.cli.{module}", "--no-dashboard", *words]
        environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        command += ["--scheduler-file", str(file)]
        started.append(subprocess.Popen(command, env=environment, **quiet))
        return started[-1]

    scheduler = start("dask_scheduler", "--port", "0", "--host", "127.0.0.1")
    deadline = time.monotonic() + 60
    while not file.exists() or not file.read_text():
        assert time.monotonic() < deadline
        time.sleep(0.1)
    address = json.loads(file.read_text())["address"]
    worker = start("dask_worker", "--no-nanny", "--nthreads", "1")
    with distributed.Client(address) as client:
        client.wait_for_workers(1, timeout=60)
    yield address, scheduler, worker
    for process in started:
        process.kill()
        process.wait()


def test_a_cluster_takes_whole_campaigns(cluster, two_campaigns, ends, tmp_path):
    each = ends(two_campaigns, f"dask:{cluster[0]}")
    assert [(end.campaign, end.exit_code) for end in each] == [("c0", 0), ("c1", 0)]
    assert (tmp_path / "out/processed/c1/trials.parquet").is_file()


@pytest.mark.parametrize(
    ("which", "what"), [(1, "the dask scheduler at .* died"), (2, "has had no worker for 2 s")]
)
@pytest.mark.nightly
def test_a_cluster_that_dies_ends_the_command(cluster, monkeypatch, which, what):
    monkeypatch.setattr(campaigns, "WITHOUT_WORKERS_S", 2.0)
    threading.Timer(3, cluster[which].kill).start()
    with pytest.raises(InputRefused, match=what):
        list(campaigns.on_cluster(cluster[0], time.sleep, [600]))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "127.0.0.1:port", "silent"])
def test_a_scheduler_that_does_not_answer_is_reported(address, monkeypatch):
    pytest.importorskip("distributed", reason="the extra nearlift[dask] is not installed")
    monkeypatch.setattr(campaigns, "ANSWER_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        # somebody listens, who is no scheduler
        address = address.replace("silent", f"tcp://127.0.0.1:{silent.getsockname()[1]}")
        what = f"no dask scheduler answers at '{address}'.*\\n  start one"
        with pytest.raises(UsageError, match=what):
            list(campaigns.on_cluster(address, abs, [1]))
