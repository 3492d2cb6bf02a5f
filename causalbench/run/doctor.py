"""`causalbench doctor`: what on this machine would make a run fail or crawl, found before it does."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from causalbench.core.numerics import compiled
from causalbench.plugins.manager import Plugins

PROBE_SECONDS = 300.0  # a first start may compile for half a minute
PROBES = {
    "simulates": "env.step(env.action_space.sample() * 0)",
    "renders": "if 'rgb' in env.worlds.capabilities: env.worlds.render(64, 48)",
}
"""What is tried on every backend in a process of its own, after a seeded reset."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at; `advice` says what to do and is empty when `ok`."""

    subject: str
    ok: bool
    text: str
    advice: str = ""


def examine(plugins: Plugins, jobs: int) -> Iterator[Finding]:
    """Look at everything, quickest first; nothing on the machine is changed."""
    yield _python()
    yield _threads(jobs)
    yield _cache()
    for row in plugins.rows:
        yield Finding(
            f"plugin {row.distribution}",
            not row.error,
            row.error or f"version {row.version} loads",
            f"pip install --upgrade {row.distribution}, or uninstall it" if row.error else "",
        )
    for name in sorted(plugins.backends):
        yield from _backend(plugins, name)


def _python() -> Finding:
    found = ".".join(map(str, sys.version_info[:3]))
    ok = sys.version_info >= (3, 11)
    return Finding("python", ok, found, "" if ok else "install Python 3.11 or newer")


def _threads(jobs: int) -> Finding:
    """Cells set torch to one thread themselves; OpenMP and BLAS obey only the environment."""
    cores = os.cpu_count() or 1
    per_cell = max((int(os.environ.get(name, "1") or 1) for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS")), default=1)
    text = f"{jobs} cells at a time with {per_cell} threads each on {cores} cores"
    if jobs * per_cell <= cores:
        return Finding("threads", True, text)
    advice = "threads that wait for each other are many times slower: set OMP_NUM_THREADS=1, or use fewer --jobs"
    return Finding("threads", False, text, advice)


def _cache() -> Finding:
    """Whether inner loops can be compiled, and whether numba can keep them where the user wants them."""
    problem, folder, chosen = compiled.problem(), compiled.cache_folder(), os.environ.get("NUMBA_CACHE_DIR", "")
    if problem:
        advice = "unset NUMBA_DISABLE_JIT" if "DISABLE_JIT" in problem else "pip install --force-reinstall numba"
        return Finding("compilation cache", False, f"inner loops run as plain Python, since {problem}", advice)
    if folder and Path(folder).is_relative_to(Path(chosen).absolute() if chosen else "/"):
        return Finding("compilation cache", True, folder)
    text = f"NUMBA_CACHE_DIR, {chosen}, cannot be written" if chosen else "no folder can be written"
    text += f"; {folder} is used instead" if folder else ": every process compiles for a minute or so"
    return Finding("compilation cache", False, text, "set NUMBA_CACHE_DIR to a folder that you can write to")


def _backend(plugins: Plugins, name: str) -> Iterator[Finding]:
    problem = plugins.problem(name)
    if problem:
        yield Finding(f"{name}: installed", False, problem, problem.partition("run: ")[2])
    if problem or plugins.backends[name].make is None:
        return
    for what, text in (("simulates", "a reset and a step"), ("renders", "a 64 x 48 picture, if it can at all")):
        error = probe(name, what)
        yield Finding(f"{name}: {what}", not error, error or text, _advice(what) if error else "")


def _advice(what: str) -> str:
    if what == "renders":
        return (
            "only pictures, videos and the observation rgb need this: install OpenGL's software renderer "
            "(Debian: apt-get install libegl1 libopengl0 libgl1-mesa-dri)"
        )
    return "see the message; `pip install -r requirements.lock` restores versions that work together"


def probe(backend: str, what: str) -> str:
    """Try one of `PROBES` in a process of its own; "" if it works, else what went wrong, in a line."""
    code = f"""
from causalbench.registration import make_env
env = make_env(backend={backend!r})
env.reset(seed=0)
{PROBES[what]}
env.close()
"""
    try:
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=PROBE_SECONDS)
    except subprocess.TimeoutExpired:
        return f"no answer in {PROBE_SECONDS:.0f} s"
    if done.returncode == 0:
        return ""
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    # The first error is the cause; later ones come from unwinding and from destructors.
    errors = [line for line in lines if re.match(r"[\w.]+(Error|Exception|Warning): ", line)]
    return (errors or lines[-1:] or [f"ended with exit code {done.returncode}"])[0]
