"""Discover a causal graph, train on it, and keep the policy: python examples/three_lines.py (some minutes)."""

import causalbench
from causalbench.discoverer import DiscoverySettings
from causalbench.learner import EvaluationSettings

ENV_STEPS, FOLDER = 20_000, "policy"
DISCOVERY, EVALUATION = DiscoverySettings(), EvaluationSettings()


def main() -> None:
    """Print how the trained policy does and save it; `backend` may name any simulator that is installed."""
    env = causalbench.make_env("pure_manipulation", backend="kinematic")
    graph = causalbench.discover(env, DISCOVERY)
    trained = causalbench.train(env, "cmSAC", graph, ENV_STEPS, evaluation=EVALUATION)

    for stage in graph.stages:
        print(f"stage {stage.stage}: {' '.join(stage.causal_actions())}")
    print(f"success after {trained.counts.env_steps} steps: {trained.evaluations[-1].success_deterministic:.0%}")
    trained.policy.save(FOLDER)  # causalbench.load_policy(FOLDER) is the same policy, with SB3's predict


if __name__ == "__main__":
    main()
