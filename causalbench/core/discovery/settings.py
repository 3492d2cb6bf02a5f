"""Every number that causal discovery needs, with the paper's values beside ours."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

from causalbench.errors import UserError

Selection = Literal["paper", "fdr"]
SELECTIONS: tuple[str, ...] = get_args(Selection)


@dataclass(frozen=True)
class DiscoverySettings:
    """Settings of Algorithms 1 and 2. The defaults are ours (see docs/discovery.md); `PRESETS["paper"]` the paper's."""

    discoverer: str = "kl"  # name of a registered method; "kl" is the paper's
    training_count: int = 3_000  # samples in D_random and in each D_do[a_k], per stage
    inference_fraction: float = 0.2  # size of D_inference relative to training_count
    sequence_length: int = 10  # steps before the scene is reset into the stage; never a function of sample count
    action_repeat: int = 1  # control steps for which an action is held while its effect is watched; each one counts
    batch_size: int = 256
    learning_rate: float = 2e-3
    max_epochs: int = 40
    patience: int = 3  # epochs without a better held-out likelihood before training stops; 0 never stops early
    sigma_train: float = 0.01  # least sigma while training, in deviations of the term
    sigma_kl: float = 0.2  # sigma floor when KL is computed, in deviations of the term
    direction: Literal["forward", "reverse", "symmetric"] = "reverse"  # KL(P1||P2), KL(P2||P1), their mean
    epsilon_cv: float = 1.0
    epsilon_normalize: float = 0.1
    epsilon_direct: float = 0.01
    n_placebos: int = 8  # action dimensions that no scene sees, probed like actions; 0 is the literal reading
    placebo_sets: int = 5  # data sets, with models of their own, in each of which every placebo is probed
    observation: Literal["state", "paper"] = "state"  # "paper": reward models see the image or the LiDAR, too
    select: Selection = "paper"  # Algorithm 2 with the gate below, or the placebos' distribution alone
    fdr: float = 0.05  # share of wrong edges among the selected ones that `select: fdr` allows
    oracle_states: int = 0  # visited states per stage by which an oracle grades and scores the graph; 0: no oracle
    placebo_gate: float = 3.0  # an action counts only if its KL exceeds this times the largest placebo's
    paired_env_steps: int = 1_250  # most control steps that `paired` takes in one stage
    permutation_states: int = 100  # states of one stage in which `permutation` compares actions
    level: float = 0.05  # of `permutation`, `fisher_z` and `kci`: chance of any false edge in a stage
    cmi_threshold: float = 0.02  # nats
    kci_samples: int = 1_000  # most samples that `kci` uses, since its cost is cubic

    def __post_init__(self) -> None:
        if self.select == "fdr" and self.discoverer != "kl":
            raise UserError(f"discovery: `select: fdr` is for the discoverer 'kl', not {self.discoverer!r}")
        if self.select == "fdr" and not self.n_placebos:
            raise UserError("discovery: `select: fdr` learns its cut from placebos; set n_placebos to at least 1")


PAPER = DiscoverySettings(
    training_count=5_000,
    batch_size=32,
    learning_rate=5e-4,
    max_epochs=100,
    patience=0,
    n_placebos=0,
)
PRESETS = {
    "quick": DiscoverySettings(),
    "paper": PAPER,  # pure manipulation
    "paper_mobile": replace(PAPER, training_count=10_000, max_epochs=500),
}
"""Named starting points; the paper's keep its data sizes and optimisation (appendix, hyperparameter setting)."""
