"""How a scene comes and goes."""

from __future__ import annotations

import sys

import numpy as np

from causalbench.conformance.bench import Bench, MakeScene, expect, in_new_process
from causalbench.conformance.moves import row, start
from causalbench.core.world.layout import Layout
from causalbench.processes import ProcessDiedError, call_in_spawned_process


def s35_close(bench: Bench) -> None:
    """S35. `close` may be called twice, and before any reset; other scenes keep working."""
    start(bench.scene, 0)
    used, fresh = bench.make_scene(), bench.make_scene()
    start(used, 1)
    for scene in (used, used, fresh, fresh):
        try:
            scene.close()
        except Exception as error:
            raise AssertionError(f"close() raised {type(error).__name__}: {error}") from error
    bench.scene.step(np.zeros(len(bench.spec.actions)))
    expect(np.isfinite(row(bench.scene.facts())).all(), "closing a scene spoilt another one")


def s36_imports(bench: Bench) -> None:
    """S36. Importing the plugin imports no simulator, none of `Backend.modules`."""
    found = in_new_process(_imported, bench.make_scene, bench.backend.modules)
    expect(not found, f"importing the module of `make` imports {', '.join(found)}: import them inside `make`")


def _imported(make_scene: MakeScene, modules: tuple[str, ...]) -> list[str]:
    """Which of `modules` are imported, `make_scene` having been unpickled and so its module imported."""
    return [name for name in modules if name in sys.modules]


def s37_spawn(bench: Bench) -> None:
    """S37. A scene can be made and reset in a process of multiprocessing's start method "spawn"."""
    layout = start(bench.scene, 0)
    try:
        problem = call_in_spawned_process(_problem, bench.make_scene, layout)
    except ProcessDiedError as error:
        problem = str(error)
    except Exception as error:
        problem = f"{type(error).__name__}: {error}"
    expect(not problem, f"in a spawned process: {problem}")


def _problem(make_scene: MakeScene, layout: Layout) -> str:
    scene = make_scene()
    scene.reset(layout)
    scene.step(np.zeros(len(scene.spec.actions)))
    finite = np.isfinite(row(scene.facts())).all()
    scene.close()
    return "" if finite else "facts are not finite"
