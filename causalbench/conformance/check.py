"""One numbered line of a contract, and the one function that runs it for every runner."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

PASS, FAIL, WARNING, GAP, NOT_APPLICABLE = "pass", "fail", "warning", "known gap", "not applicable"


class OnTheBench(Protocol):
    """What is checked: `offers` names all that a check may need, `known_gaps` the lines that do not hold, and why."""

    @property
    def offers(self) -> Collection[str]:
        """Names of what is there to be checked."""

    @property
    def known_gaps(self) -> Mapping[str, str]:
        """Number -> reason."""


@dataclass(frozen=True)
class Check:
    """One numbered line of the contract.

    `needs`: what must be on offer, without which it does not apply. `otherwise`: the outcome where it does not hold.
    """

    function: Callable[[Any], None]
    needs: tuple[str, ...] = ()
    otherwise: str = FAIL

    @property
    def number(self) -> str:
        """Such as "S7"."""
        return self._line[0]

    @property
    def sentence(self) -> str:
        """What must be true: the first paragraph of the function's docstring, without the number."""
        return self._line[2]

    @property
    def test_name(self) -> str:
        """Such as `test_s07_quaternions`; public, so never renamed."""
        return f"test_{self.function.__name__}"

    @property
    def place(self) -> str:
        """Where the whole text of the line and what is measured stand: file and line of the check."""
        return f"{inspect.getsourcefile(self.function)}:{inspect.getsourcelines(self.function)[1]}"

    @property
    def _line(self) -> tuple[str, str, str]:
        return (inspect.getdoc(self.function) or "").partition("\n\n")[0].replace("\n", " ").partition(". ")


@dataclass(frozen=True)
class Result:
    """What one check found. `message` says what is wrong, why it does not apply, or why it is a known gap."""

    number: str
    sentence: str
    outcome: str
    message: str
    seconds: float
    place: str  # file:line of the check


def run_check(check: Check, bench: OnTheBench) -> Result:
    """Run one check; a known gap turns a failure into a gap, and anything else into a failure."""
    started = time.perf_counter()
    gap = bench.known_gaps.get(check.number)
    missing = [name for name in check.needs if name not in bench.offers]
    if missing:
        outcome, message = NOT_APPLICABLE, f"needs {', '.join(missing)}, which is not declared"
    else:
        message = _failure(check, bench)
        outcome = check.otherwise if message else PASS
    if gap is not None:
        if outcome == FAIL:
            outcome, message = GAP, f"{gap} (now: {message})"
        else:
            outcome, message = FAIL, f"a known gap ({gap}), but the check says: {outcome}. Remove it from known_gaps"
    return Result(check.number, check.sentence, outcome, message, time.perf_counter() - started, check.place)


def _failure(check: Check, bench: OnTheBench) -> str:
    try:
        check.function(bench)
    except AssertionError as error:
        return str(error) or "an assertion without a message failed in the plugin"
    except Exception as error:  # a stranger's code may raise anything
        return f"{type(error).__name__}: {error}"
    return ""
