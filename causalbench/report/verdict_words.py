"""A verdict as a sentence."""

from __future__ import annotations

from causalbench.report.judged import AREA, Judged
from causalbench.report.stats import ALPHA


def sentence(judged: Judged) -> str:
    """The verdict with its evidence, and what it is worth."""
    measure = "" if judged.measure == AREA else " by steps to 90%"
    claim = f"{_claim(judged)} {_place(judged)}{measure}"
    if judged.obstacle:
        told = f"{claim}: {judged.obstacle}."
    else:
        told = f"{claim}: {_evidence(judged)}."
        told += _limits(judged) if judged.verdict == "not decided" else ""
    return told if judged.stated else f"Exploratory: {told}"


def _place(judged: Judged) -> str:
    return "on all backends together" if judged.backend == "all" else f"on {judged.backend}"


def _claim(judged: Judged) -> str:
    left, right, within = judged.hypothesis.left, judged.hypothesis.right, judged.hypothesis.within
    if judged.verdict in ("not run", "not decided"):
        return f"{judged.hypothesis.text} is {judged.verdict}"
    if judged.verdict == "equivalent":
        return f"{left} and {right} are equivalent within {within:g}"
    return f"{left} is {judged.verdict} than {right}" + ("" if within is None else f" by more than {within:g}")


def _evidence(judged: Judged) -> str:
    p, adjusted, (n, m) = judged.p_value, judged.adjusted, judged.sizes
    if judged.measure == AREA:
        told = f"a difference of {judged.difference:+.3f} in success area"
        told += ", 95% interval {:+.3f} to {:+.3f}".format(*judged.interval) if judged.interval else ", no 95% interval"
    else:
        told = f"{judged.difference:+,.0f} environment steps saved within the budget, log-rank test"
    among = f", {adjusted:.2g} among {judged.comparisons} comparisons" if judged.comparisons > 1 else ""
    return f"{told}, p = {p:.2g}{among}, {n} against {m} runs"


def _limits(judged: Judged) -> str:
    """What so many seeds could have shown."""
    compared = judged.comparison
    assert compared is not None
    if compared.least_p > ALPHA:
        return f" So few seeds cannot decide anything: no p-value of theirs is below {compared.least_p:.2g}."
    if compared.least_p * judged.comparisons > ALPHA:
        few = f"No p-value of so few seeds is below {compared.least_p:.2g}"
        return f" {few}, too much for the first of {judged.comparisons} comparisons."
    if compared.detectable is None or judged.measure != AREA:
        return ""
    return f" These seeds would have shown a true difference of {compared.detectable:.3f} four times in five."
