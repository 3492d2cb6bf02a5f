"""Stage 4 of pure manipulation: the oracle calls arm motion a strong cause of the grasp, discovery takes `grip` alone.

    python benchmarks/discovery_contact.py --backends gymrob robosuite pybullet

Three questions, a table each. `motion`: how often does a step that closes the gripper end in a grasp, by how each arm
action moves? `pairs`: with a_k at 0 instead of random, same state and other actions, how often is a
grasp lost and how often gained? `inputs`: how well does a boosted classifier, trained on the samples of all seeds but
the first, tell the grasps of the first seed, and how much worse does it without one action? The difference in log loss
is what that action says of the grasp beyond state and other actions (nats), which is all that any method can see that
reads samples. Needs scikit-learn, which comes with the extra `causal-learn`.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from discoveries import Row, folder, measured, options, put_together, read_samples

from causalbench.core.discovery.samples.transitions import Samples, StageSamples
from causalbench.core.discovery.truth.counterfactual import Walk
from causalbench.core.discovery.truth.oracle import SEQUENCE_LENGTH
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.plugins.manager import installed

NAME, STAGE, STATES = "discovery_contact", 4, 400
ARM = range(len(TASK.actions) - 1)
N_STATE = len(TASK.state_names) + 1
LEAVE_OUT = {
    "nothing": (), **{a: (k,) for k, a in enumerate(TASK.actions)}, "arm": (*ARM,),
    "arm but armz": tuple(k for k in ARM if TASK.actions[k] != "armz"),
}  # fmt: skip


def pairs(backend: str) -> list[Row]:
    """Per action: grasps with the drawn action, lost and gained with it at 0."""
    scene = installed().backend(backend).make()
    walk = Walk(TASK, scene, STAGE, np.random.default_rng([7, STAGE]), SEQUENCE_LENGTH)
    held = np.array([walk.compare()[:, 0] for _ in range(STATES)]) > 0  # (states, n_actions + 2)
    scene.close()
    return [
        Row(backend=backend, action=action, states=STATES, held=int(held[:, 0].sum()))
        | {"lost": int((held[:, 0] & ~without).sum()), "gained": int((~held[:, 0] & without).sum())}
        for action, without in zip(("repeated", *TASK.actions), held[:, 1:].T, strict=True)
    ]


def motion(backend: str, seeds: list[int], discoveries: Path) -> list[Row]:
    """Per arm action: share of closing steps that end in a grasp, by fifths of the action's range from -1 to 1."""
    sets = [s for seed in seeds for s in random_sets(read_samples(folder(discoveries, backend, seed))[STAGE - 1])]
    actions, rewards = (np.concatenate(c) for c in zip(*((s.actions, s.rewards) for s in sets), strict=True))
    closing = actions[:, TASK.actions.index("grip")] > 0
    held = rewards[closing, 0] > 0
    rows = []
    for k in ARM:
        fifth = np.digitize(actions[closing, k], np.linspace(-1, 1, 6)[1:-1])
        shares = {f"fifth_{i + 1}": held[fifth == i].mean() for i in range(5)}
        rows.append(Row(backend=backend, action=TASK.actions[k], steps=int(closing.sum())) | shares)
    return rows


def random_sets(data: StageSamples) -> list[Samples]:
    """The sets in which no action that matters to the grasp is held at 0 throughout."""
    return [data.random, data.inference] + ([data.extra] if data.extra else [])


def table_of(sets: list[Samples]) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (n, ...): state, the hand's place relative to the box, actions; and whether the box is held after it."""
    states, actions = (np.concatenate(c) for c in zip(*((s.states, s.actions) for s in sets), strict=True))
    relative = states[:, 3:6] - states[:, :3]
    return np.hstack([states, relative, actions[:, : len(TASK.actions)]]), np.concatenate(
        [s.rewards[:, 0] > 0 for s in sets]
    )


def inputs(backend: str, seeds: list[int], discoveries: Path) -> list[Row]:
    """Log loss and R2 of the grasp on the first seed, with some of the actions left out, by number of samples."""
    from sklearn.ensemble import HistGradientBoostingClassifier

    first, *others = (read_samples(folder(discoveries, backend, seed))[STAGE - 1] for seed in seeds)
    # D_do of the arm holds one action at 0; D_do[grip] has no grasp.
    training = [s for data in others for s in (*random_sets(data), *data.interventions[:-1])]
    test, truth = table_of(random_sets(first))
    sequence = np.concatenate([s.sequence + 10**6 * i for i, s in enumerate(random_sets(first))])
    x, y = table_of(training)
    order = np.random.default_rng(0).permutation(len(x))
    rows = []
    for count in (3_000, len(x)):
        chosen, baseline = order[:count], np.zeros(len(truth))
        for name, left_out in LEAVE_OUT.items():
            columns = np.delete(np.arange(x.shape[1]), [N_STATE + 3 + k for k in left_out])
            model = HistGradientBoostingClassifier(
                max_iter=200, learning_rate=0.05, early_stopping=True, random_state=0
            ).fit(x[chosen][:, columns], y[chosen])
            p = model.predict_proba(test[:, columns])[:, 1].clip(1e-6, 1 - 1e-6)
            loss = -np.where(truth, np.log(p), np.log(1 - p))
            if name == "nothing":
                baseline = loss
            more, error = mean_and_error(loss - baseline, sequence)
            r2 = 1 - np.square(p - truth).mean() / truth.var()
            rows.append(
                Row(backend=backend, samples=count, without=name, grasps=truth.mean(), log_loss=loss.mean(), r2=r2)
                | {"nats": more, "nats_low": more - 1.96 * error, "nats_high": more + 1.96 * error}
            )
    return rows


def mean_and_error(values: np.ndarray, group: np.ndarray) -> tuple[float, float]:
    """Mean of `values` (n,) and its standard error; those of one group depend on each other."""
    mean = values.mean()
    _, index = np.unique(group, return_inverse=True)
    sums = np.bincount(index, values - mean)
    return float(mean), float(np.sqrt(np.square(sums).sum()) / len(values))


def main() -> None:
    """Measure what is missing and print the tables."""
    args = options(__doc__, NAME, ("gymrob", "robosuite", "pybullet"), 5).parse_args()
    for backend in args.backends:
        measured(args.work / "pairs" / f"{backend}.csv", partial(pairs, backend))
        measured(args.work / "motion" / f"{backend}.csv", partial(motion, backend, [*args.seeds], args.discoveries))
        if len(args.seeds) > 1:
            measured(args.work / "inputs" / f"{backend}.csv", partial(inputs, backend, [*args.seeds], args.discoveries))
    for name in ("motion", "pairs", "inputs"):
        print(put_together(args.work / name, f"{NAME}_{name}", args.docs, ("backend",)).round(4).to_string(index=False))


if __name__ == "__main__":
    main()
