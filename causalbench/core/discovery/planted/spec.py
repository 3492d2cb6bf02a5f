"""What a planted world is, as data: the parts of every reward term, stage by stage."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.planted.forms import FORMS
from causalbench.core.tasks.stage_task import StageTask, Term
from causalbench.errors import UserError

VERSION = 1
"""Of all planted worlds: raised by any change after which a world of a name and a seed is another one."""
N_STATE = 4
"""State variables; the last is hidden from whoever observes."""
N_OBSERVED = 3

Noise = Literal["normal", "student_t3", "lognormal"]
Shape = Literal["plain", "binary", "sparse"]


@dataclass(frozen=True)
class Part:
    """One effect on a term: `share` of the term's variance, through `form` of the actions numbered `actions`.

    `state` numbers the state variable that forms with a state look at. With `lag` 1 the actions of the step before
    count, which is no effect of this step's.
    """

    form: str
    actions: tuple[int, ...]
    share: float
    state: int = 0
    lag: int = 0


@dataclass(frozen=True)
class PlantedTerm:
    """One reward term: `parts`, a `state_share` of its variance from a state variable, and noise for the rest.

    Terms that name one `noise_number` share their noise; None is a noise of its own. A "binary" term is 1 where the
    sum is above 0, a "sparse" one where it is above 2.3 deviations. Then `scale` multiplies and `offset` is added.
    """

    parts: tuple[Part, ...] = ()
    state_share: float = 0.0
    state: int = 0
    noise: Noise = "normal"
    noise_number: int | None = None
    shape: Shape = "plain"
    scale: float = 1.0
    offset: float = 0.0

    @property
    def noise_share(self) -> float:
        """Share of the variance that is noise: what parts and state leave."""
        return max(0.0, 1.0 - self.state_share - sum(part.share for part in self.parts))


@dataclass(frozen=True)
class PlantedWorld:
    """A world whose causal graph is known, because it was written down.

    - `stages`: the terms of every stage, as many in each;
    - `driven`: by state variable, the number of the action that moves it and the share of its change; such a variable
      is observed, persists, and makes an action of this step a part of what later steps see;
    - `leaves`: by stage, the action whose value above a limit finishes it;
    - `restore_noise`: share of each term's variance that is drawn anew after a snapshot was restored; 0: exact;
    - `restores`: False where the world has no snapshots at all;
    - `constant`: terms that never vary, by number.
    """

    kind: str
    seed: int
    n_actions: int
    stages: tuple[tuple[PlantedTerm, ...], ...]
    driven: tuple[tuple[int, int, float], ...] = ()
    leaves: tuple[tuple[int, float], ...] = ()
    restore_noise: float = 0.0
    restores: bool = True
    constant: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for term in (term for stage in self.stages for term in stage):
            if term.state_share + sum(part.share for part in term.parts) > 1.0 + 1e-9:
                raise UserError(f"planted world {self.name!r}: the shares of {term} are more than 1")
            if unknown := [part.form for part in term.parts if part.form not in FORMS]:
                raise UserError(f"planted world {self.name!r}: no form {unknown[0]!r}; there are {', '.join(FORMS)}")

    @property
    def name(self) -> str:
        """Kind and seed."""
        return f"{self.kind}-{self.seed}"

    @property
    def n_terms(self) -> int:
        """Reward terms of every stage."""
        return len(self.stages[0])

    @property
    def task(self) -> StageTask:
        """The world as a staged task, which learners and discoverers know; the declared graph is empty."""
        stages = tuple(range(1, len(self.stages) + 1))
        return StageTask(
            name=f"planted_{self.kind}",
            version=VERSION,
            env_id="causalbench/Planted-v0",
            n_stages=len(stages),
            actions=tuple(f"a{k}" for k in range(self.n_actions)),
            terms=tuple(Term(f"r{j}", stages, True, "a planted reward") for j in range(self.n_terms)),
            state_names=tuple(f"s{i}" for i in range(N_OBSERVED)),
            horizon=50,
            constants=self._data(),
            manual_graph={},
        )

    def _data(self) -> dict[str, Any]:
        return asdict(self)

    def causes(self, stage: int) -> NDArray[np.bool_]:
        """(n_actions, n_terms) whether the formula of a term in `stage` (from 1) reads an action of the same step."""
        found = np.zeros((self.n_actions, self.n_terms), dtype=bool)
        for j, term in enumerate(self.stages[stage - 1]):
            for part in term.parts:
                if not part.lag and j not in self.constant:
                    found[list(part.actions), j] = True
        return found
