"""Copies, pickles, threads and forks: what a person's program does to an environment beside stepping it."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
import threading
import warnings
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.conformance.bench import Bench, MakeScene, expect, in_new_process
from causalbench.conformance.moves import start
from causalbench.core.staged.scene_worlds import make_scene_worlds
from causalbench.core.staged.worlds import Worlds
from causalbench.core.tasks import pure_manipulation as task
from causalbench.core.world.cameras import HEIGHT, WIDTH
from causalbench.core.world.scene import Scene
from causalbench.errors import CausalbenchError

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
TIMEOUT = 60.0  # s that a picture in another thread or process may take


def s50_copies(bench: Bench) -> None:
    """S50. A scene refuses to be copied or pickled; a copy or pickle of a task's worlds continues as the original does.

    A simulator keeps state that Python does not see. Worlds are made anew by `make` and restored from a snapshot, the
    pickle in a new process: to the bit with `EXACT_RESTORE`, else within `spec.restore_error` in 10 steps.
    """
    start(bench.scene, 0)
    ways: dict[str, Callable[[Scene], Any]] = {
        "copy.copy": copy.copy, "copy.deepcopy": copy.deepcopy, "pickle.dumps": pickle.dumps,
    }  # fmt: skip
    for name, way in ways.items():
        try:
            way(bench.scene)
        except CausalbenchError:
            continue
        except Exception as error:
            raise AssertionError(f"{name}(scene) raised {type(error).__name__}: {error}") from error
        raise AssertionError(f"{name}(scene) went through: leave `__reduce_ex__`, `__copy__` and `__deepcopy__` alone")
    worlds = _begun(bench.make_scene)
    twin, pickled = copy.deepcopy(worlds), pickle.dumps(worlds)
    expected = _states(worlds)
    for what, found in (("deep copy", _states(twin)), ("pickle", in_new_process(_states_of, pickled))):
        off = np.abs(found - expected).max()
        expect(off <= max(bench.spec.restore_error, 1e-12), f"a {what} of the worlds goes on otherwise, by {off:.2g}")
    for one in (worlds, twin):
        one.close()


def _begun(make_scene: MakeScene) -> Worlds:
    worlds = make_scene_worlds(task.TASK, make_scene)
    worlds.reset([0], [np.random.default_rng(0)], 1)
    for _ in range(3):
        worlds.step(np.full(len(task.TASK.actions), 0.3))
    return worlds


def _states(worlds: Worlds) -> Array:
    """(11, n) what is observed now and in 10 steps."""
    rows = [worlds.states().astype(np.float64)]
    for _ in range(10):
        worlds.step(np.linspace(-0.5, 0.5, len(task.TASK.actions)))
        rows.append(worlds.states().astype(np.float64))
    return np.array(rows)


def _states_of(pickled: bytes) -> Array:
    return _states(pickle.loads(pickled))


def s51_picture_in_a_thread(bench: Bench) -> None:
    """S51. A picture in another thread is the same as in the one that drew first.

    Then one more in the first thread.
    """
    scene = bench.scene
    start(scene, 0)
    first, answers = scene.render(WIDTH, HEIGHT), list[Any]()
    thread = threading.Thread(target=lambda: answers.append(_drawn(scene)), daemon=True)
    thread.start()
    thread.join(TIMEOUT)
    expect(answers, f"render in another thread did not return within {TIMEOUT:.0f} s")
    expect(isinstance(answers[0], np.ndarray), f"render in another thread raised {answers[0]}")
    expect(np.array_equal(first, answers[0]), "render in another thread shows something else")
    expect(np.array_equal(first, scene.render(WIDTH, HEIGHT)), "after a picture in another thread, another one here")


def s52_picture_after_a_fork(bench: Bench) -> None:
    """S52. A picture in a forked process, after one in the first, is the same or is refused with a sentence.

    Never does it hang. To refuse is to raise a `CausalbenchError`.
    """
    scene = bench.scene
    start(scene, 0)
    first = scene.render(WIDTH, HEIGHT)
    answer = _in_fork(scene)
    if answer is None:
        raise AssertionError(f"render in a forked process did not return within {TIMEOUT:.0f} s")
    if isinstance(answer, np.ndarray):
        expect(np.array_equal(first, answer), "render in a forked process shows something else")
    else:
        expect(answer.startswith("CausalbenchError"), f"render in a forked process raised {answer}")


def _in_fork(scene: Scene) -> Picture | str | None:
    """What `_drawn` says in a forked process; None if it says nothing in time."""
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe()
    process = context.Process(target=_send_picture, args=(there, scene), daemon=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Python 3.12 warns of a fork of a process with threads
        process.start()
    there.close()
    try:
        return here.recv() if here.poll(TIMEOUT) else None
    except EOFError:
        process.join()
        return f"nothing: the process ended with {process.exitcode}"
    finally:
        process.kill()
        process.join()


def _send_picture(link: Connection, scene: Scene) -> None:
    link.send(_drawn(scene))


def _drawn(scene: Scene) -> Picture | str:
    try:
        return scene.render(WIDTH, HEIGHT)
    except CausalbenchError as error:
        return f"CausalbenchError: {error}"
    except Exception as error:  # a stranger's code may raise anything
        return f"{type(error).__name__}: {error}"
