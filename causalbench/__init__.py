"""causalbench: does knowing which actions cause which rewards make multi-stage robot tasks learnable?

`import causalbench` makes the environments known to `gymnasium.make`, and so does an id that names the module:
`gymnasium.make("causalbench:causalbench/PureManipulation-v0")`, in any process. Names are imported on first use, so
that it costs little more than `import gymnasium`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from causalbench._version import __version__
from causalbench.lazy import lazy
from causalbench.plugins.environment_ids import register_on_import

if TYPE_CHECKING:
    from causalbench.api import discover, load_graph, train
    from causalbench.core.discovery.settings import DiscoverySettings
    from causalbench.core.learners.policy import load_policy
    from causalbench.core.learners.ppo.settings import PPOSettings
    from causalbench.core.learners.sac.settings import SACSettings
    from causalbench.core.learners.settings import EvaluationSettings
    from causalbench.core.staged.env import VectorReward
    from causalbench.registration import make_env
    from causalbench.report.frames import load_results
    from causalbench.report.html.page import write_report
    from causalbench.running import run_suite

_HOMES = {
    "DiscoverySettings": "causalbench.core.discovery.settings",
    "EvaluationSettings": "causalbench.core.learners.settings",
    "PPOSettings": "causalbench.core.learners.ppo.settings",
    "SACSettings": "causalbench.core.learners.sac.settings",
    "VectorReward": "causalbench.core.staged.env",
    "discover": "causalbench.api",
    "load_graph": "causalbench.api",
    "load_policy": "causalbench.core.learners.policy",
    "load_results": "causalbench.report.frames",
    "make_env": "causalbench.registration",
    "run_suite": "causalbench.running",
    "train": "causalbench.api",
    "write_report": "causalbench.report.html.page",
}

__all__ = [
    "DiscoverySettings",
    "EvaluationSettings",
    "PPOSettings",
    "SACSettings",
    "VectorReward",
    "__version__",
    "discover",
    "load_graph",
    "load_policy",
    "load_results",
    "make_env",
    "run_suite",
    "train",
    "write_report",
]

__getattr__ = lazy(__name__, _HOMES)
register_on_import()


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
