"""Processes: how they are started, talked to and ended. Knows nothing of what they do."""

from __future__ import annotations

import contextlib
import fcntl
import functools
import multiprocessing
import multiprocessing.connection
import os
import pickle
import queue
import signal
import subprocess
import sys
import tempfile
import types
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

Method = Literal["spawn", "forkserver"]
Job = TypeVar("Job")
Result = TypeVar("Result")
Work = Callable[[Job, Callable[[Any], None]], Result]
"""What a worker does with a job; the second argument reports to the process that asked."""


class ProcessDiedError(RuntimeError):
    """Raised when a process ends before it has answered; says how it ended."""


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def use_one_thread_each() -> None:
    """One thread for each process that is started from here on, since sums must not depend on how many there are.

    For this process, too, if numpy has not been imported yet.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


LEAVING = 10.0  # s that a process may take to end once nobody can talk with it


@dataclass
class Child:
    """A process of ours and this end of the link to it."""

    process: BaseProcess
    link: Connection

    def resident_bytes(self) -> int:
        """See `resident_bytes`."""
        return resident_bytes(self.process.pid or 0)

    def is_alive(self) -> bool:
        """Whether it still runs."""
        return self.process.is_alive()

    def terminate(self) -> None:
        """Ask it to end, by SIGTERM."""
        self.process.terminate()

    def wait(self, seconds: float) -> None:
        """Wait until it has ended, but no longer than `seconds`.

        `Process.join` would wait for ever for one that has closed its files and lives on.
        """
        with contextlib.suppress(ProcessLookupError):  # it has ended, and its parent knows
            assert self.process.pid is not None
            handle = os.pidfd_open(self.process.pid)
            try:
                multiprocessing.connection.wait([handle], max(seconds, 0.0))
            finally:
                os.close(handle)

    def kill(self) -> None:
        """End it at once, in the middle of whatever it does, with all that it has started."""
        self.process.kill()
        self.process.join()
        self._end_group()

    def leave(self) -> None:
        """Wait until it has ended, as it does soon after its end of the link is closed; one that lives on is killed."""
        self.wait(LEAVING)
        self.kill()

    def close(self) -> None:
        """Wait until it has ended, end what it has started and release the link."""
        self.process.join()
        self._end_group()
        self.link.close()

    def _end_group(self) -> None:
        assert self.process.pid is not None
        with contextlib.suppress(ProcessLookupError):  # it has left nobody behind
            os.killpg(self.process.pid, signal.SIGKILL)

    def how_it_ended(self) -> str:
        """Such as "was killed by SIGSEGV" or "exited with code 1"; waits until it has ended."""
        self.process.join()
        code = self.process.exitcode or 0
        return f"was killed by {signal.Signals(-code).name}" if code < 0 else f"exited with code {code}"


def start(method: Method, function: Callable[..., None], *arguments: Any) -> Child:
    """Run `function(link, *arguments)` in a new process, which never outlives this one.

    Everything must pickle. "spawn" starts a fresh interpreter that shares this one's output; "forkserver" forks one
    that has imported what `preload` names. Ctrl-C is left to this process.
    """
    spawn, forkserver = multiprocessing.get_context("spawn"), multiprocessing.get_context("forkserver")
    context = spawn if method == "spawn" else forkserver
    link, far_end = context.Pipe()
    process = context.Process(target=_begin, args=(function, far_end, *arguments))
    process.start()
    far_end.close()
    return Child(process, link)


@contextlib.contextmanager
def without_main() -> Iterator[None]:
    """Processes that are started within do not import this one's main module, which is a person's script.

    For functions and arguments that come from modules of their own.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def resident_bytes(process: int) -> int:
    """Resident memory of a process and of all that it has started, pages that they share once for each; Linux only.

    0 once it is gone.
    """
    parents: dict[int, int] = {}
    pages: dict[int, int] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it has ended meanwhile
            fields = path.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
            parents[int(path.parent.name)], pages[int(path.parent.name)] = int(fields[1]), int(fields[21])
    own, grown = {process}, True
    while grown:
        started = {child for child, parent in parents.items() if parent in own} - own
        own, grown = own | started, bool(started)
    return sum(pages.get(one, 0) for one in own) * os.sysconf("SC_PAGE_SIZE")


def preload(modules: Sequence[str]) -> None:
    """What the fork server imports once for all; takes effect when its first process is started."""
    multiprocessing.get_context("forkserver").set_forkserver_preload(list(modules))


def _begin(function: Callable[..., None], link: Connection, *arguments: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.setpgid(0, 0)  # so that what it starts, as some simulators do, can be ended with it
    _die_with_parent()
    function(link, *arguments)


def _die_with_parent() -> None:
    """A parent that is killed cannot end its processes, which would go on to write where others do.

    The kernel does it, as soon as the parent's end of the pipe between them is closed: a simulator may never return to
    Python, so that no thread could.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None
    pipe = parent.sentinel
    fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    if multiprocessing.connection.wait([pipe], timeout=0):  # closed before that
        os._exit(1)


class Pool(Generic[Job, Result]):
    """Processes that work on jobs in turn; each makes a worker of its own by `make_work` and keeps it.

    `on_report` gets what the workers report, in threads of this process.
    """

    def __init__(self, size: int, make_work: Callable[[], Work[Job, Result]], on_report: Callable[[Any], None]) -> None:
        self.on_report = on_report
        self.children = [start("spawn", _serve, make_work) for _ in range(size)]
        self._idle = queue.SimpleQueue[Child]()
        for child in self.children:
            self._idle.put(child)
        self._threads = ThreadPoolExecutor(size)  # one waits for the answer of each process

    def submit(self, job: Job) -> Future[Result]:
        """The result of a job to come. It raises what the worker raised, or `ProcessDiedError`."""
        return self._threads.submit(self._ask, job)

    def _ask(self, job: Job) -> Result:
        child = self._idle.get()
        try:
            child.link.send(job)
            while (answer := child.link.recv())[0] == "report":
                self.on_report(answer[1])
        except (EOFError, OSError) as error:
            child.leave()
            raise ProcessDiedError(f"a process {child.how_it_ended()} before it had answered") from error
        finally:
            self._idle.put(child)
        kind, content = answer
        if kind == "error":
            raise content
        result: Result = content
        return result

    def close(self) -> None:
        """End the processes, in the middle of a job if need be."""
        for child in self.children:
            child.kill()
        self._threads.shutdown(cancel_futures=True)
        for child in self.children:
            child.close()


def _serve(link: Connection, make_work: Callable[[], Work[Job, Result]]) -> None:
    """What a process of a pool does until it is killed."""
    work = make_work()
    while True:
        job = link.recv()
        try:
            link.send(("result", work(job, lambda message: link.send(("report", message)))))
        except Exception as error:  # whatever the work raises is the caller's
            link.send(("error", _portable(error)))


def _portable(error: Exception) -> Exception:
    """The error, or one that says the same where it does not survive the way between processes."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def call_in_spawned_process(function: Callable[..., Result], *arguments: Any) -> Result:
    """`function(*arguments)` in a process of its own by the start method "spawn".

    Raises what the function raises, and `ProcessDiedError`.
    """
    pool = Pool[tuple[Any, ...], Result](1, functools.partial(_caller, function), lambda report: None)
    try:
        return pool.submit(arguments).result()
    finally:
        pool.close()


def _caller(function: Callable[..., Result]) -> Work[tuple[Any, ...], Result]:
    return lambda arguments, report: function(*arguments)


def call_in_new_interpreter(function: Callable[..., Any], *arguments: Any, timeout: float) -> Any:
    """`function(*arguments)` in a Python process that has nothing of this one but its search path and environment.

    A spawned process would import this one's main module first. Raises `ProcessDiedError` with the last line that the
    process printed when it does not return within `timeout` seconds, and what pickle raises for what does not pickle.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        (path / "job").write_bytes(pickle.dumps((function, arguments)))
        # Through files: some simulators greet the world on stdout.
        command = [sys.executable, "-c", f"from {__name__} import serve_one; serve_one()", str(path)]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        try:
            done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=timeout)
        except subprocess.TimeoutExpired:
            raise ProcessDiedError(f"a new process did not finish within {timeout:.0f} s") from None
        if done.returncode != 0:
            last = (done.stderr.strip() or f"exit code {done.returncode}").splitlines()[-1]
            raise ProcessDiedError(f"a new process failed: {last}")
        return pickle.loads((path / "result").read_bytes())


def serve_one() -> None:
    """What the process of `call_in_new_interpreter` does."""
    path = Path(sys.argv[1])
    function, arguments = pickle.loads((path / "job").read_bytes())
    (path / "result").write_bytes(pickle.dumps(function(*arguments)))
