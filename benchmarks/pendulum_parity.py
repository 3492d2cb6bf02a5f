"""One-stage mSAC and mPPO beside SB3's on Pendulum-v1: python benchmarks/pendulum_parity.py --seeds 5 (half an hour).

The learners read only `stage` and the reward vector, so a task of one stage and one term is the plain algorithm, and
its learning curve must be SB3's within seeds. Same networks, settings, budget and evaluation episodes. Printed as the
mean over seeds with a 95% Student interval, look by look and for the mean of all looks; the curves agree where the
interval of the difference holds 0. Runs that `--out` already holds are not repeated.
"""

from __future__ import annotations

import argparse
import csv
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
import torch
from scipy.stats import t as student
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_util import make_vec_env

from causalbench.core.learners.learner import StagedLearner
from causalbench.core.learners.methods import METHODS
from causalbench.core.learners.policy import ObservationScale
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.learners.ppo.staged import StagedPPO
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.learners.sac.staged import StagedSAC
from causalbench.core.tasks.stage_task import Term

EPISODES, EPISODE_STEPS = 10, 200
HIGH = np.array([1.0, 1.0, 8.0], dtype=np.float32)  # of Pendulum's observation
SCALE = ObservationScale(tuple(map(float, -HIGH)), tuple(map(float, HIGH)))
SETTINGS: dict[str, SACSettings | PPOSettings] = {
    "SAC": SACSettings(
        batch_size=256, learning_rate=1e-3, buffer_size=10_000, learning_starts=500, train_every=1,
        updates_per_sample=1.0, ent_coef_init=1.0,
    ),
    "PPO": PPOSettings(
        n_steps=1024, learning_rate=1e-3, gamma=0.9, gae_lambda=0.95, log_std_init=0.0, target_kl=1e9, n_envs=4
    ),
}  # fmt: skip
BUDGET = {"SAC": 6_000, "PPO": 100_000}
LOOKS = 10


@dataclass(frozen=True)
class OneStage:
    """What the learners read of a task."""

    actions: tuple[str, ...] = ("torque",)
    terms: tuple[Term, ...] = (Term("reward", (1,), False, "Pendulum's own"),)
    n_stages: int = 1


def pendulums(n: int, seed: int) -> gym.vector.SyncVectorEnv:
    """`n` pendulums whose observations and actions are scaled to [-1, 1], for both sides."""

    def one() -> gym.Env[Any, Any]:
        env = gym.wrappers.RescaleAction(gym.make("Pendulum-v1"), np.float32(-1), np.float32(1))
        space = gym.spaces.Box(-1, 1, (3,), np.float32)
        return gym.wrappers.TransformObservation(env, lambda obs: (obs / HIGH).astype(np.float32), space)

    env = gym.vector.SyncVectorEnv([one] * n, autoreset_mode=gym.vector.AutoresetMode.SAME_STEP)
    env.reset(seed=seed)
    return env


def score(act: Callable[[np.ndarray], np.ndarray]) -> float:
    """Mean return of `EPISODES` deterministic episodes, from the same starts for all."""
    env = pendulums(EPISODES, 10_000)
    obs, _ = env.reset(seed=10_000)
    total = np.zeros(EPISODES)
    for _ in range(EPISODE_STEPS):
        obs, rewards, *_ = env.step(act(obs))
        total += rewards
    env.close()
    return float(total.mean())


def staged(obs: np.ndarray) -> dict[str, np.ndarray]:
    """The adapter: an observation with a stage, before the scaling that the learners undo."""
    return {"state": obs * HIGH, "stage": np.zeros(len(obs), dtype=np.int64)}


def ours(name: str, seed: int) -> list[float]:
    """Scores of our one-stage learner at each look."""
    settings = SETTINGS[name]
    method = next(m for m in METHODS if m.name == f"m{name}")
    make: Callable[..., StagedLearner] = {"SAC": StagedSAC, "PPO": StagedPPO}[name]
    learner = make(OneStage(), method, None, SCALE, settings, seed)
    env, scores = pendulums(settings.n_envs, seed), []
    obs, _ = env.reset(seed=seed)
    ones = np.ones(settings.n_envs, dtype=np.int64)
    for step in range(settings.n_envs, BUDGET[name] + 1, settings.n_envs):
        actions = learner.act(staged(obs))
        following, rewards, terminated, truncated, infos = env.step(actions.clip(-1, 1).astype(np.float32))
        reached = following.copy()
        for world in np.flatnonzero(truncated):
            reached[world] = infos["final_obs"][world]
        step_infos = {
            "vector_reward": rewards[:, None], "stage": ones, "next_stage": ones,
            "is_success": terminated, "final_obs": staged(reached),
        }  # fmt: skip
        learner.remember(staged(obs), actions, step_infos, terminated | truncated)
        learner.train()
        obs = following
        if step % (BUDGET[name] // LOOKS) == 0:
            scores.append(score(lambda o: learner.policy.predict(staged(o))[0]))
    env.close()
    return scores


def stock(name: str, seed: int) -> list[float]:
    """Scores of SB3's agent at each look."""
    s = SETTINGS[name]

    def one() -> gym.Env[Any, Any]:
        return pendulums(1, seed).envs[0]

    env = make_vec_env(one, s.n_envs, seed=seed)
    shared: dict[str, Any] = {
        "learning_rate": s.learning_rate, "batch_size": s.batch_size, "gamma": s.gamma, "seed": seed, "device": "cpu",
    }  # fmt: skip
    arch: dict[str, Any] = {"net_arch": list(s.net_arch)}
    model: SAC | PPO
    if isinstance(s, SACSettings):
        model = SAC(
            "MlpPolicy", env, buffer_size=s.buffer_size, tau=s.tau, learning_starts=s.learning_starts,
            train_freq=s.train_every, gradient_steps=1, ent_coef=f"auto_{s.ent_coef_init}", policy_kwargs=arch,
            **shared,
        )  # fmt: skip
    else:
        model = PPO(
            "MlpPolicy", env, n_steps=s.n_steps // s.n_envs, n_epochs=s.n_epochs, gae_lambda=s.gae_lambda,
            clip_range=s.clip_range, ent_coef=s.ent_coef, vf_coef=s.vf_coef, max_grad_norm=s.max_grad_norm,
            policy_kwargs=arch | {"log_std_init": s.log_std_init}, **shared,
        )  # fmt: skip
    scores: list[float] = []
    look = BUDGET[name] // LOOKS

    def on_step(local: dict[str, Any], _: dict[str, Any]) -> bool:
        if local["self"].num_timesteps % look == 0:
            scores.append(score(lambda o: model.predict(o, deterministic=True)[0]))
        return len(scores) < LOOKS

    model.learn(BUDGET[name], callback=on_step)
    return scores


def interval(values: list[float]) -> float:
    """Half the width of the 95% Student interval of the mean."""
    if len(values) < 2:
        return float("nan")
    return float(student.ppf(0.975, len(values) - 1)) * statistics.stdev(values) / len(values) ** 0.5


def report(name: str, curves: dict[str, dict[int, list[float]]]) -> None:
    """Print the means of both sides and of their differences, look by look and over all looks."""
    columns = [(f"{(i + 1) * BUDGET[name] // LOOKS:6d}", slice(i, i + 1)) for i in range(LOOKS)]
    print(f"steps   m{name}          SB3 {name}       difference")
    for label, looks in [*columns, ("  mean", slice(None))]:
        a, b = ([statistics.mean(run[looks]) for run in runs.values()] for runs in curves.values())
        gap = [x - y for x, y in zip(a, b, strict=True)]
        cells = [f"{statistics.mean(values):6.0f} +- {interval(values):4.0f}" for values in (a, b, gap)]
        print("  ".join([label, *cells]))


def draw(curves: dict[str, dict[str, dict[int, list[float]]]], path: Path) -> None:
    """Both sides' mean curves with their 95% intervals, one panel a learner."""
    figure, axes = plt.subplots(1, len(curves), figsize=(4.5 * len(curves), 3.2), squeeze=False)
    for axis, (name, sides) in zip(axes[0], curves.items(), strict=True):
        steps = [(i + 1) * BUDGET[name] // LOOKS for i in range(LOOKS)]
        for who, runs in sides.items():
            looks = [list(values) for values in zip(*runs.values(), strict=True)]
            means, widths = [statistics.mean(v) for v in looks], [interval(v) for v in looks]
            (line,) = axis.plot(steps, means, label=f"{who}, {len(runs)} seeds")
            low, high = ([m + sign * w for m, w in zip(means, widths, strict=True)] for sign in (-1, 1))
            axis.fill_between(steps, low, high, alpha=0.2, color=line.get_color())
        axis.set(xlabel="env steps", ylabel="mean return", title="Pendulum-v1")
        axis.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=120, metadata={"Software": None})


def main() -> None:
    """Train both sides for every seed, print the curves, and write every score with `--out`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--learner", choices=["SAC", "PPO"], action="append")
    parser.add_argument("--out", type=Path, help="CSV of every score")
    parser.add_argument("--figure", type=Path, help="PNG of the curves")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    held: dict[tuple[str, int], list[float]] = {}
    if arguments.out and arguments.out.exists():
        with arguments.out.open(newline="") as file:
            for row in csv.DictReader(file):
                held.setdefault((row["learner"], int(row["seed"])), []).append(float(row["mean_return"]))
    curves: dict[str, dict[str, dict[int, list[float]]]] = {}
    for name in arguments.learner or ["SAC", "PPO"]:
        sides: dict[str, Callable[[str, int], list[float]]] = {f"m{name}": ours, f"SB3 {name}": stock}
        curves[name] = {who: {} for who in sides}
        for seed in range(arguments.seeds):
            for who, run in sides.items():
                if (who, seed) not in held:
                    held[who, seed] = run(name, seed)
                    print(f"{who} seed {seed}: {' '.join(f'{x:.0f}' for x in held[who, seed])}", flush=True)
                    if arguments.out:
                        write(held, arguments.out)
                curves[name][who][seed] = held[who, seed]
        report(name, curves[name])
    if arguments.figure:
        draw(curves, arguments.figure)


def write(held: dict[tuple[str, int], list[float]], path: Path) -> None:
    """Every score, one row a look."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("learner", "seed", "env_steps", "mean_return"))
        for (who, seed), scores in sorted(held.items()):
            budget = BUDGET[who.removeprefix("SB3 ").removeprefix("m")]
            rows.writerows((who, seed, (i + 1) * budget // LOOKS, f"{x:.3f}") for i, x in enumerate(scores))


if __name__ == "__main__":
    main()
