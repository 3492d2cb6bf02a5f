"""An author of a learner imports this module alone. `examples/a_learner` is a worked example.

Importing it imports no torch: what needs it is imported when it is first asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.core.learners.registry import Learner, Policy, Trained, TrainingProblem
from causalbench.core.learners.settings import EvaluationSettings, StagedSettings
from causalbench.errors import DivergedError, UserError
from causalbench.lazy import lazy
from causalbench.plugins.hookspecs import hookimpl

if TYPE_CHECKING:
    from causalbench.core.learners.causal_gradient import StagePlan as StagePlan
    from causalbench.core.learners.causal_gradient import stage_plan as stage_plan
    from causalbench.core.learners.counting import Counter as Counter
    from causalbench.core.learners.examiner import Examiner as Examiner
    from causalbench.core.learners.learner import StagedLearner as StagedLearner
    from causalbench.core.learners.policy import ObservationScale as ObservationScale
    from causalbench.core.learners.policy import StagedPolicy as StagedPolicy
    from causalbench.core.learners.training import train_staged as train_staged

_WITH_TORCH = {
    "Counter": "counting",
    "Examiner": "examiner",
    "ObservationScale": "policy",
    "StagePlan": "causal_gradient",
    "StagedLearner": "learner",
    "StagedPolicy": "policy",
    "stage_plan": "causal_gradient",
    "train_staged": "training",
}

__all__ = [
    "CausalGraph",
    "Counter",
    "DivergedError",
    "Evaluation",
    "EvaluationSettings",
    "Examiner",
    "Learner",
    "ObservationScale",
    "Policy",
    "StagePlan",
    "StagedLearner",
    "StagedPolicy",
    "StagedSettings",
    "Trained",
    "TrainingCounts",
    "TrainingProblem",
    "UserError",
    "hookimpl",
    "stage_plan",
    "train_staged",
]

__getattr__ = lazy(__name__, {name: f"causalbench.core.learners.{module}" for name, module in _WITH_TORCH.items()})
