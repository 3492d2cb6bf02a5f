"""Processes of ours: what they answer, and that none outlives the one that started it."""

import multiprocessing.connection
import os
import signal
import subprocess
import sys
import threading
from functools import partial

import pytest

from causalbench.processes import (
    Pool,
    ProcessDiedError,
    call_in_new_interpreter,
    call_in_spawned_process,
    start,
)


class TwoPartsError(Exception):
    """Does not survive pickling: it is made of two parts and keeps one text."""

    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def _counting(first):
    """Work that counts the jobs of its process."""
    jobs = [first]

    def work(job, report):
        jobs.append(job)
        report((job, len(jobs)))
        return os.getpid(), len(jobs)

    return work


def _acting():
    def work(job, report):
        if job == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if job == "close all files":
            os.closerange(3, 4096)
            threading.Event().wait()
        if job == "raise":
            raise FileNotFoundError("no such thing")
        if job == "raise oddly":
            raise TwoPartsError("a", "b")
        if job == "wait":
            report("waiting")
            threading.Event().wait()
        return job

    return work


def _divided(a, b):
    return a / b


@pytest.fixture
def acting():
    told = threading.Event()
    pool = Pool(1, _acting, lambda report: told.set())
    pool.told = told
    yield pool
    pool.close()


def test_every_process_keeps_its_worker_and_reports_to_this_one():
    reports = []
    pool = Pool(2, partial(_counting, "first"), reports.append)
    try:
        answers = [future.result() for future in [pool.submit(job) for job in range(12)]]
    finally:
        pool.close()
    pids = {pid for pid, _ in answers}
    assert os.getpid() not in pids
    for pid in pids:
        counts = sorted(count for other, count in answers if other == pid)
        assert counts == list(range(2, len(counts) + 2))
    assert sorted(job for job, _ in reports) == list(range(12))


def test_an_error_is_the_callers_and_the_process_goes_on(acting):
    with pytest.raises(FileNotFoundError, match="no such thing"):
        acting.submit("raise").result()
    with pytest.raises(RuntimeError, match="TwoPartsError: a and b"):
        acting.submit("raise oddly").result()
    assert acting.submit("well").result() == "well"


def test_a_process_that_dies_says_how(acting):
    with pytest.raises(ProcessDiedError, match="was killed by SIGKILL"):
        acting.submit("die").result()


def test_a_process_that_closes_its_link_and_lives_on_is_ended(acting, monkeypatch):
    monkeypatch.setattr("causalbench.processes.LEAVING", 0.1)
    with pytest.raises(ProcessDiedError, match="was killed by SIGKILL"):
        acting.submit("close all files").result()


def test_a_pool_that_is_closed_ends_its_processes_in_the_middle_of_a_job(acting):
    future = acting.submit("wait")
    assert acting.told.wait(60)
    acting.close()
    assert not any(child.is_alive() for child in acting.children)
    assert isinstance(future.exception(), ProcessDiedError)


ORPHANED = """
import ctypes, os, sys, threading
from causalbench import processes

def child(link):
    link.send(os.getpid())
    ctypes.PyDLL(None).sleep(600)  # with the lock of the interpreter, so that no thread of this process runs either

if __name__ == "__main__":
    started = processes.start(sys.argv[1], child)
    print(started.link.recv(), flush=True)
    threading.Event().wait()
"""


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_no_process_outlives_a_parent_that_is_killed(method, tmp_path):
    script = tmp_path / "orphaned.py"
    script.write_text(ORPHANED)
    with subprocess.Popen([sys.executable, script, method], stdout=subprocess.PIPE, text=True) as parent:
        assert int(parent.stdout.readline()) != parent.pid
        parent.kill()
        assert parent.stdout.read() == ""  # returns when the last process that holds the pipe is gone


def _starts_another(link):
    link.send(subprocess.Popen(["sleep", "600"]).pid)


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_what_a_process_has_started_ends_with_it(method):
    child = start(method, _starts_another)
    left = os.pidfd_open(child.link.recv())
    child.close()
    assert multiprocessing.connection.wait([left], timeout=60)  # readable once it has ended
    os.close(left)


def test_a_function_is_called_elsewhere():
    assert call_in_spawned_process(_divided, 1, 2) == 0.5
    with pytest.raises(ZeroDivisionError):
        call_in_spawned_process(_divided, 1, 0)
    assert call_in_new_interpreter(os.path.join, "a", "b", timeout=60) == os.path.join("a", "b")
    with pytest.raises(ProcessDiedError, match="did not finish within 0 s"):
        call_in_new_interpreter(os.path.join, "a", "b", timeout=0.01)
