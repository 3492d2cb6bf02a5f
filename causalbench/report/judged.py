"""One hypothesis on one board by one measure, and the verdict on it."""

from __future__ import annotations

from dataclasses import dataclass

from causalbench.report.comparison import Comparison
from causalbench.report.stats import ALPHA
from causalbench.suite.hypotheses import Hypothesis

AREA, STEPS = "success_auc", "steps_to_90"


@dataclass(frozen=True)
class Judged:
    """One hypothesis on one board by one measure; `comparison` is None where `obstacle` says why there is none.

    `adjusted` is the p-value for all `comparisons` of the measure, each look at a comparison counting as one.
    """

    hypothesis: Hypothesis
    backend: str
    measure: str
    stated: bool
    sizes: tuple[int, int]
    missing: int
    comparisons: int
    obstacle: str = ""
    comparison: Comparison | None = None
    difference: float | None = None
    adjusted: float | None = None

    @property
    def p_value(self) -> float | None:
        """That of the hypothesis, or of its contrary if that is nearer."""
        if self.comparison is None:
            return None
        within = self.hypothesis.within
        either = self.comparison.shifts.two_sided(within or 0.0)
        return either if within is None else min(either, self.comparison.shifts.equivalence(within))

    @property
    def verdict(self) -> str:
        """Better, worse, equivalent, not decided, not run."""
        if self.comparison is None and not sum(self.sizes):
            return "not run"
        if self.comparison is None or self.adjusted is None or self.adjusted > ALPHA:
            return "not decided"
        within = self.hypothesis.within
        if within is not None and self.comparison.shifts.equivalence(within) == self.p_value:
            return "equivalent"
        return "better" if self.comparison.shifts.difference > 0 else "worse"

    @property
    def decided(self) -> bool:
        """Whether the verdict is one that further seeds do not change."""
        return self.verdict not in ("not decided", "not run")

    @property
    def interval(self) -> tuple[float, float] | None:
        """Of the difference in success areas, by the test of this comparison alone."""
        return self.comparison.shifts.interval(ALPHA) if self.comparison and self.measure == AREA else None
