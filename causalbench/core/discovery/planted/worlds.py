"""A planted world as `Worlds`: what every discoverer is given, vectorised, with snapshots that hold its noise."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.planted.forms import FORMS
from causalbench.core.discovery.planted.spec import N_OBSERVED, N_STATE, VERSION, PlantedTerm, PlantedWorld
from causalbench.core.staged.observation import Observation, Observe, checked_choice, no_sectors, sense_nothing
from causalbench.core.staged.worlds import Origin, Step, Worlds, check_count
from causalbench.core.world.capabilities import Capability
from causalbench.errors import UserError

Array = NDArray[np.float64]
Keys = NDArray[np.uint64]

PERSISTENCE = 0.8  # of a state variable from step to step
SPARSE_ABOVE = 2.3  # deviations: about one step in a hundred
GOLDEN, FIRST, SECOND = (np.uint64(x) for x in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))


def make_planted_worlds(world: PlantedWorld, n: int | None = None) -> PlantedWorlds:
    """New worlds, one or `n` that step together: with one argument bound, a `MakeWorlds`."""
    check_count(n)
    worlds = PlantedWorlds(world, () if n is None else (n,))
    worlds.recipe = functools.partial(make_planted_worlds, world, n)
    return worlds


class PlantedWorlds(Worlds):
    """The worlds of one `PlantedWorld`.

    Noise is a function of a key, which is part of the state, and of the number of steps since a reset. So a step is
    the same to the bit after a snapshot was restored, unless the world has `restore_noise`: that has a key of its own,
    which every restoring changes.
    """

    def __init__(self, world: PlantedWorld, shape: tuple[int, ...]) -> None:
        self.world, self.shape, self.task = world, shape, world.task
        self.origin = Origin(f"planted {VERSION}", "numpy", "none")
        self.identity = {"backend": "planted", "version": VERSION, "world": world.name}
        can = {Capability.STAGE_RESET}
        can |= {Capability.RESTORE} if world.restores else set()
        can |= {Capability.EXACT_RESTORE} if world.restores and not world.restore_noise else set()
        self.capabilities = frozenset(can)
        self.render_fps = 10
        self.stage = np.zeros(shape, dtype=np.int64)
        self._variables, self._before = np.zeros((self.n, N_STATE)), np.zeros((self.n, world.n_actions))
        self._keys, self._restored_keys = np.zeros(self.n, np.uint64), np.zeros(self.n, np.uint64)
        self._count, self._restores = np.zeros(self.n, np.uint64), 0
        self.choose_observation()

    def reset(self, worlds: Sequence[int], rngs: Sequence[np.random.Generator], stage: int | None = None) -> None:
        """See `Worlds`; the state is drawn from the distribution that random actions lead to."""
        for index, rng in zip(worlds, rngs, strict=True):
            self._variables[index] = rng.normal(size=N_STATE)
            self._before[index] = rng.uniform(-1.0, 1.0, self.world.n_actions)
            self._keys[index] = rng.integers(2**63)
            self._restored_keys[index] = self._keys[index] ^ FIRST
            self._count[index] = 0
            self.stage.reshape(-1)[index] = stage or 1

    def _step(self, actions: Array, repeat: int) -> Step:
        """See `Worlds`; a reward is the sum over the control steps."""
        rows, stage = actions.reshape(self.n, -1), self.stage.reshape(-1)
        rewards = np.zeros((self.n, self.world.n_terms))
        for _ in range(repeat):
            draws = normals(self._keys, self._count, N_STATE + 2 * self.world.n_terms)
            rewards += self._rewards(stage, rows, draws[:, N_STATE:])
            self._advance(rows, draws[:, :N_STATE])
        leaves = self._leaves(stage, rows)
        last = leaves & (stage == self.task.n_stages)
        following = np.where(leaves & ~last, stage + 1, stage)
        no, shape = np.zeros(self.shape, dtype=bool), self.shape
        next_stage, success = following.reshape(shape), last.reshape(shape)
        return Step(self.stage.copy(), next_stage, rewards.reshape(*shape, -1), success, no, success)

    def _rewards(self, stage: NDArray[np.int64], actions: Array, draws: Array) -> Array:
        """(n, n_terms) of `actions` now, by two noises a term, `draws` (n, 2 n_terms)."""
        rewards, share = np.zeros((self.n, self.world.n_terms)), self.world.restore_noise
        fresh = normals(self._restored_keys, self._count, self.world.n_terms) if share else None
        for number, terms in enumerate(self.world.stages, start=1):
            here = stage == number
            if not here.any():
                continue
            for j, term in enumerate(terms):
                if j in self.world.constant:
                    rewards[here, j] = term.offset
                    continue
                number_of_noise = j if term.noise_number is None else term.noise_number
                noises = draws[here, number_of_noise], draws[here, self.world.n_terms + j]
                core = _sum(term, actions[here], self._before[here], self._variables[here], *noises)
                if fresh is not None:
                    core = math.sqrt(1 - share) * core + math.sqrt(share) * fresh[here, j]
                rewards[here, j] = term.offset + term.scale * _shaped(term, core)
        return rewards

    def _advance(self, actions: Array, draws: Array) -> None:
        """Move the state variables by what drives them and by noise (n, N_STATE)."""
        change = draws.copy()
        for variable, action, share in self.world.driven:
            own = math.sqrt(3.0) * actions[:, action]
            change[:, variable] = math.sqrt(share) * own + math.sqrt(1 - share) * change[:, variable]
        self._variables = PERSISTENCE * self._variables + math.sqrt(1 - PERSISTENCE**2) * change
        self._before = actions.copy()
        self._count = self._count + np.uint64(1)

    def _leaves(self, stage: NDArray[np.int64], actions: Array) -> NDArray[np.bool_]:
        out = np.zeros(self.n, dtype=bool)
        for number, (action, limit) in enumerate(self.world.leaves, start=1):
            out |= (stage == number) & (actions[:, action] > limit)
        return out

    def states(self) -> NDArray[np.float32]:
        """See `Worlds`; the last variable is hidden."""
        return self._variables[:, :N_OBSERVED].astype(np.float32).reshape(*self.shape, N_OBSERVED)

    def sense(self, sensor: str) -> NDArray[Any]:
        """See `Worlds`; there is no sensor."""
        return sense_nothing(self.task, sensor, self.shape)

    def choose_observation(self, gripper: bool = True, observe: Observe = "state", features: bool = True) -> None:
        """See `Worlds`; there is nothing to choose."""
        if observe == "sectors":
            raise no_sectors(self.task)
        self.observed = checked_choice(gripper, observe, features)
        state = gym.spaces.Box(-np.inf, np.inf, (N_OBSERVED,), np.float32)
        self.observation_space = gym.spaces.Dict({"state": state, "stage": gym.spaces.Discrete(self.task.n_stages)})

    def observe(self) -> Observation:
        """See `Worlds`."""
        return {"state": self.states(), "stage": self.stage - 1}

    def snapshot(self, world: int) -> bytes:
        """See `Worlds`."""
        self.require(Capability.RESTORE, "taking a snapshot")
        whole = np.array([self._keys[world], self._restored_keys[world], self._count[world]], np.uint64)
        numbers = np.concatenate([self._variables[world], self._before[world]])
        return whole.tobytes() + np.int64(self.stage.reshape(-1)[world]).tobytes() + numbers.tobytes()

    def restore(self, worlds: Sequence[int], snapshots: Sequence[bytes]) -> None:
        """See `Worlds`."""
        self.require(Capability.RESTORE, "returning to a snapshot")
        for index, snapshot in zip(worlds, snapshots, strict=True):
            whole, numbers = np.frombuffer(snapshot[:24], np.uint64), np.frombuffer(snapshot[32:])
            self._keys[index], self._restored_keys[index], self._count[index] = whole
            self.stage.reshape(-1)[index] = np.frombuffer(snapshot[24:32], np.int64)[0]
            self._variables[index], self._before[index] = np.split(numbers, [N_STATE])
            if self.world.restore_noise:
                self._restores += 1
                self._restored_keys[index] = mixed(self._keys[index] ^ mixed(np.uint64(self._restores)))

    def saved(self) -> tuple[Any, ...]:
        """The state of all worlds, for `load`: what snapshots hold, cheaply and without changing what is drawn anew."""
        arrays = (self._variables, self._before, self._keys, self._restored_keys, self._count, self.stage)
        return tuple(array.copy() for array in arrays)

    def load(self, saved: tuple[Any, ...]) -> None:
        """Return all worlds to what was `saved`."""
        (self._variables, self._before, self._keys, self._restored_keys, self._count, self.stage) = (
            array.copy() for array in saved
        )

    def expert(self, worlds: Sequence[int] | None = None) -> Array:
        """See `Worlds`; nobody knows better than chance."""
        raise UserError(f"task {self.task.name!r} has no expert")

    def render(self, width: int, height: int) -> NDArray[np.uint8]:
        """See `Worlds`; there is nothing to see."""
        raise UserError(f"task {self.task.name!r} cannot be drawn")

    def close(self) -> None:
        """See `Worlds`."""


def _sum(term: PlantedTerm, actions: Array, before: Array, state: Array, noise: Array, second: Array) -> Array:
    """(n,) the sum of a term's parts, of mean 0 and variance 1."""
    total = math.sqrt(term.state_share) * state[:, term.state]
    total += math.sqrt(term.noise_share) * NOISES[term.noise](noise)
    for part in term.parts:
        acting = (before if part.lag else actions)[:, list(part.actions)]
        total += math.sqrt(part.share) * FORMS[part.form].value(acting, state[:, part.state], second)
    return total


def _shaped(term: PlantedTerm, value: Array) -> Array:
    if term.shape == "plain":
        return value
    return (value > (0.0 if term.shape == "binary" else SPARSE_ABOVE)).astype(np.float64)


def mixed(x: Any) -> Any:
    """The 64 bits of SplitMix64's output function."""
    with np.errstate(over="ignore"):
        x = (x ^ (x >> np.uint64(30))) * FIRST
        x = (x ^ (x >> np.uint64(27))) * SECOND
        return x ^ (x >> np.uint64(31))


def normals(keys: Keys, count: Keys, size: int) -> Array:
    """(n, size) standard normal numbers, a function of each world's key and step `count`, both (n,)."""
    from scipy.special import ndtri

    with np.errstate(over="ignore"):
        numbers = (count[:, None] * np.uint64(size) + np.arange(1, size + 1, dtype=np.uint64)) * GOLDEN
        bits = mixed(mixed(keys)[:, None] + numbers)
    return np.asarray(ndtri(((bits >> np.uint64(11)) + 0.5) / 2.0**53))


def _student_t3(normal: Array) -> Array:
    from scipy.special import ndtr, stdtrit

    return np.asarray(stdtrit(3.0, ndtr(normal)) / math.sqrt(3.0))


def _lognormal(normal: Array) -> Array:
    return np.asarray((np.exp(normal) - math.sqrt(math.e)) / math.sqrt((math.e - 1) * math.e))


NOISES = {"normal": lambda normal: normal, "student_t3": _student_t3, "lognormal": _lognormal}
"""From a standard normal number to noise of mean 0 and variance 1."""
