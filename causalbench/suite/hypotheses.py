"""Hypotheses: what a suite says about its methods before any of them runs."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass

from causalbench.digests import content_hash
from causalbench.names import PATTERN

_FORM = re.compile(rf"(?P<left>{PATTERN}) (?P<sign>>|==) (?P<right>{PATTERN})(?: within (?P<within>\S+))?")


@dataclass(frozen=True)
class Hypothesis:
    """Method `left` has a larger success area than `right`, or, with `within`, one that differs by at most that."""

    left: str
    right: str
    within: float | None = None

    @property
    def text(self) -> str:
        """As a suite has it."""
        if self.within is None:
            return f"{self.left} > {self.right}"
        return f"{self.left} == {self.right} within {self.within:g}"

    @classmethod
    def parse(cls, text: str) -> Hypothesis:
        """The hypothesis in `text`: "cmSAC > mSAC" or "cmSAC == cmSAC-scalar within 0.1". Raises `ValueError`."""
        found = _FORM.fullmatch(text)
        if not found:
            raise ValueError(f"{text!r}: expected `A > B` or `A == B within 0.1`, A and B being methods of this suite")
        left, sign, right, within = (found[name] for name in ("left", "sign", "right", "within"))
        if left == right:
            raise ValueError(f"{text!r}: a method is not compared with itself")
        if sign == ">" and within is not None:
            raise ValueError(f"{text!r}: `within` belongs to `==`; write `{left} > {right}`")
        return cls(left, right, _delta(text, within) if sign == "==" else None)


def _delta(text: str, within: str | None) -> float:
    if within is None:
        raise ValueError(
            f"{text!r}: say which difference of the success area still counts as none: `{text} within 0.1`"
        )
    try:
        delta = float(within)
    except ValueError:
        delta = 0.0
    if not 0 < delta < 1:
        raise ValueError(f"{text!r}: expected a difference of success areas between 0 and 1, got {within!r}")
    return delta


@dataclass(frozen=True)
class Statement:
    """What a run sets out to show: the hypotheses, and the backends and seeds on which they are judged.

    These are those of the suite's tier, whatever cells a command picks: what is missing of them stays missing. With
    `looks`, numbers of seeds, seeds are added from look to look until every hypothesis is decided.
    """

    suite: str
    tier: str
    hypotheses: tuple[str, ...]
    backends: tuple[str, ...]
    seeds: tuple[int, ...]
    looks: tuple[int, ...] = ()

    @property
    def hash(self) -> str:
        """Hash of all that is stated."""
        return content_hash(asdict(self))
