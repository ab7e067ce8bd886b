"""Work shared with copies of a process: the same answers in the same order, whatever becomes of the
copies.
"""

from __future__ import annotations

import subprocess
import sys

import pytest

ALONE = """
import os
from nearlift.run import copies
assert copies.alone()
here, fork, made = os.getpid(), os.fork, []
os.fork = lambda: made.append(fork()) or made[-1]
"""
WANTED = str([i * i for i in range(23)])
pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="processes are copied on Linux only"
)


def by_itself(code: str) -> str:
    """What code prints that runs in a process with one thread."""
    return subprocess.run(
        [sys.executable, "-c", ALONE + code], check=True, capture_output=True, text=True, timeout=60
    ).stdout.strip()


@pytest.mark.parametrize("workers", [1, 2, 3, 40])
def test_answers_come_in_order_and_from_every_worker(workers):
    code = f"""
done = list(copies.shared_out(lambda i: (i * i, os.getpid()), range(23), {workers}))
print([square for square, _ in done], len(set(pid for _, pid in done)), any(os.path.exists(f"/proc/{{pid}}") for pid in made))
"""
    assert by_itself(code) == f"{WANTED} {min(workers, 23)} False"


@pytest.mark.parametrize(
    "end", ["os._exit(0)", "os.kill(os.getpid(), 9)", "raise MemoryError", "sys.stdout = 1 / 0"]
)
def test_what_a_copy_does_not_answer_is_done_here(end):
    code = f"""
import sys
def square(i):
    if os.getpid() != here and i > 8:
        {end}
    return i * i
print(list(copies.shared_out(square, range(23), 3)))
"""
    assert by_itself(code) == WANTED


def test_without_room_for_a_process_everything_is_done_here():
    code = """
def none():
    raise BlockingIOError
os.fork = none
print(list(copies.shared_out(lambda i: i * i, range(23), 3)), len(os.listdir("/proc/self/fd")) < 8)
"""
    assert by_itself(code) == f"{WANTED} True"


def test_what_the_task_raises_is_raised_and_nobody_is_left():
    code = """
def refusing(i):
    if i == 4:
        raise ValueError("four")
    return i
seen = []
try:
    seen.extend(copies.shared_out(refusing, range(23), 2))
except ValueError as fault:
    print(seen, fault, any(os.path.exists(f"/proc/{pid}") for pid in made))
"""
    assert by_itself(code) == "[0, 1, 2, 3] four False"


def test_who_stops_listening_leaves_no_copy_behind():
    code = """
answers = copies.shared_out(lambda i: bytes(1 << 20), range(400), 2)
print(len(next(answers)))
answers.close()
print(any(os.path.exists(f"/proc/{pid}") for pid in made))
"""
    assert by_itself(code).split() == [str(1 << 20), "False"]


def test_a_process_with_threads_is_not_alone():
    code = """
import threading
stop = threading.Event()
thread = threading.Thread(target=stop.wait)
thread.start()
print(copies.alone())
stop.set()
thread.join()
"""
    assert by_itself(code) == "False"


def test_where_nobody_may_wait_for_children_the_answers_are_the_same():
    code = """
import signal
signal.signal(signal.SIGCHLD, signal.SIG_IGN)
print(list(copies.shared_out(lambda i: i * i, range(23), 3)))
"""
    assert by_itself(code) == WANTED


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
def test_an_interrupt_ends_a_copy_and_not_its_original(number):
    code = f"""
import signal
def square(i):
    if os.getpid() != here and i > 8:
        os.kill(os.getpid(), signal.{number})
    return i * i
try:
    print(list(copies.shared_out(square, range(23), 3)))
finally:
    print("here" if os.getpid() == here else "a copy went on")
"""
    assert by_itself(code).splitlines() == [WANTED, "here"]
