"""Mountain car in stages: swing until the car has the energy to leave the valley (1), then climb (2).

The environment is Gymnasium's own and knows no stages. A second action, `horn`, does nothing, as discovery should find.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.task import GymTask, Seen, Term, by_name, causal_sets, hookimpl

Array = NDArray[np.float64]


class Constants(NamedTuple):
    """Every number of the task."""

    enough: float = 0.3  # energy from which stage 2 begins, in heights of the hill: -1 in the valley, 1 at its top
    goal: float = 0.45  # position that is success, as in the environment
    per_energy: float = 10.0
    per_speed: float = 100.0
    per_effort: float = 0.1
    bonus: float = 2.0


C = Constants()
TERMS = (
    Term("r_energy", (1,), True, "gain of energy"),
    Term("r_speed", (2,), True, "gain of speed to the right"),
    Term("r_effort", (1, 2), True, "cost of driving"),
    Term("r_success", (1, 2), False, "bonus for a step into stage 2 or to success"),
)


def make() -> Any:
    """The environment with its two actions; it draws when a film is made."""
    import gymnasium as gym  # importing a plugin imports no simulator

    car = gym.make("MountainCarContinuous-v0", render_mode="rgb_array")
    return gym.wrappers.TransformAction(car, lambda action: action[:1], gym.spaces.Box(-1.0, 1.0, (2,), np.float32))


def observe(seen: Seen) -> Array:
    """Position and speed."""
    return seen.observation


def energy(seen: Seen) -> float:
    """Height plus speed squared, in heights of the hill; what the motor does not change is constant."""
    position, speed = seen.observation
    return float(np.sin(3 * position) + 600 * speed**2)


def stage(seen: Seen) -> int:
    """U(s): 2 with enough energy, else 1."""
    return 2 if energy(seen) >= C.enough else 1


def success(before: int, now: Seen) -> bool:
    """The car is at the goal."""
    return bool(now.observation[0] >= C.goal)


def rewards(before: Seen, was: int, action: Array, now: Seen, becomes: int) -> Array:
    """The terms (4,) of a step, each as if it belonged to every stage."""
    energy_gain, speed_gain = energy(now) - energy(before), now.observation[1] - before.observation[1]
    bonus = C.bonus * (becomes > was or success(was, now))
    return np.array([C.per_energy * energy_gain, C.per_speed * speed_gain, -C.per_effort * action[0] ** 2, bonus])


def expert(seen: Seen) -> Array:
    """Full force the way the car moves."""
    return np.array([1.0 if seen.observation[1] >= 0 else -1.0, 0.0])


def snapshot(env: Any) -> bytes:
    """Position and speed, behind the letter of their type: a start has another than what follows."""
    state = env.unwrapped.state
    return state.dtype.char.encode() + state.tobytes()


def restore(env: Any, content: bytes) -> Seen:
    """Put the car back."""
    env.unwrapped.state = np.frombuffer(content[1:], content[:1].decode())
    return Seen(env.unwrapped.state.astype(np.float32), {})


TASK = GymTask(
    name="mountain_car",
    version=0,
    env_id="mountain_car/MountainCar-v0",
    n_stages=2,
    actions=("drive", "horn"),
    terms=TERMS,
    state_names=("position", "speed"),
    horizon=300,
    constants=by_name(C),
    manual_graph=causal_sets({1: {"r_energy": "drive", "r_effort": "drive"}, 2: {"r_speed": "drive"}}),
    environments={"gymnasium": make},
    stage=stage,
    success=success,
    rewards=rewards,
    observe=observe,
    state_bounds=(np.array([-1.2, -0.07]), np.array([0.6, 0.07])),
    snapshot=snapshot,
    restore=restore,
    exact_restore=True,
    expert=expert,
)


@hookimpl
def causalbench_tasks(register: Callable[[Any], None]) -> None:
    """Tell causalbench about the task."""
    register(TASK)
