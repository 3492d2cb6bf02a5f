"""What a check works with: one backend on the test bench, and `expect`."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

from causalbench.core.world.scene import Scene, SceneSpec
from causalbench.errors import CausalbenchError
from causalbench.plugins.backends import NO_OPTIONS, Backend
from causalbench.processes import ProcessDiedError, call_in_new_interpreter

MakeScene = Callable[[], Scene]

TIMEOUT = 300.0  # s that a new process may take


def expect(condition: Any, message: str) -> None:
    """Raise an `AssertionError` with `message` unless `condition` holds; works under `python -O` too."""
    if not condition:
        raise AssertionError(message)


def in_new_process(function: Callable[..., Any], *arguments: Any) -> Any:
    """`function(*arguments)`, computed in a new interpreter; all of it must be picklable.

    Raises `AssertionError` that says why when it does not return.
    """
    try:
        return call_in_new_interpreter(function, *arguments, timeout=TIMEOUT)
    except ProcessDiedError as error:
        raise AssertionError(str(error)) from None
    except Exception as error:  # pickle raises what the object's own methods raise
        raise AssertionError(
            f"what another process needs to make a scene cannot be pickled ({error}): "
            "`make` must be a function at the top level of a module"
        ) from error


class Bench:
    """Makes scenes of one backend and closes them; `scene` is shared by all checks, each of which resets it.

    `variant` is what the backend registers of scenes made with these options. Raises `UserError` for a backend that
    makes no scenes, or not with these options.
    """

    def __init__(self, backend: Backend, options: Mapping[str, Any] = NO_OPTIONS) -> None:
        self.backend = backend
        self.variant = backend.variant(options)
        self.make_scene: MakeScene = backend.maker(options)
        self._scenes: list[Scene] = []

    def make(self) -> Scene:
        """A new scene."""
        self._scenes.append(self.make_scene())
        return self._scenes[-1]

    @functools.cached_property
    def scene(self) -> Scene:
        """The shared scene. Raises `CausalbenchError` when the backend cannot make one."""
        try:
            return self.make()
        except CausalbenchError:
            raise
        except Exception as error:  # a stranger's code may raise anything
            raise CausalbenchError(
                f"backend {self.backend.name!r} could not make a scene: {type(error).__name__}: {error}"
            ) from error

    @property
    def spec(self) -> SceneSpec:
        """The spec of the shared scene."""
        return self.scene.spec

    @property
    def offers(self) -> frozenset[str]:
        """Actions and capabilities that the shared scene declares."""
        return self.spec.capabilities | frozenset(self.spec.actions)

    @property
    def known_gaps(self) -> Mapping[str, str]:
        """Lines that do not hold, as the backend registers them."""
        return self.backend.known_gaps

    def close(self) -> None:
        """Close every scene made here."""
        for scene in self._scenes:
            scene.close()
