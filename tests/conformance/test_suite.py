"""The suite itself: a scene that is wrong in one way fails exactly that check, an intact one none."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest
from conformance.broken import BROKEN, INTACT, MOBILE_NUMBERS, FarWorkspace, Higher, WideWorkspace, backend

from causalbench.conformance.bench import Bench
from causalbench.conformance.check import Result, run_check
from causalbench.conformance.suite import CHECKS, run_checks
from causalbench.errors import UnknownNameError, UserError

NUMBERS = [check.number for check in CHECKS]
IN_NEW_PROCESSES = frozenset({"S28", "S33", "S36", "S37", "S50"})


def outcomes(results: list[Result], outcome: str) -> dict[str, str]:
    return {result.number: result.message for result in results if result.outcome == outcome}


def test_there_is_a_broken_scene_for_every_number() -> None:
    assert list(BROKEN) == NUMBERS == [f"S{i}" for i in range(1, len(CHECKS) + 1)]


@pytest.mark.parametrize("number", NUMBERS)
def test_a_broken_scene_fails_exactly_its_check(number: str) -> None:
    """New processes, which take most of the time, are only started for the line that the scene is wrong in.

    Scenes that are wrong in driving are only checked for driving.
    """
    bench = Bench(BROKEN[number])
    checks = [check for check in CHECKS if check.number not in IN_NEW_PROCESSES - {number}]
    if number in MOBILE_NUMBERS:
        checks = [check for check in checks if check.number in MOBILE_NUMBERS]
    failed = outcomes([run_check(check, bench) for check in checks], "fail")
    assert list(failed) == [number], failed
    assert len(failed[number]) > 30  # a sentence, not a bare name


def test_a_workspace_larger_than_the_reach_fails_one_line_and_the_message_says_why() -> None:
    bench = Bench(backend(WideWorkspace))
    failed = outcomes([run_check(check, bench) for check in CHECKS if check.number not in IN_NEW_PROCESSES], "fail")
    assert list(failed) == ["S12"], failed
    assert re.fullmatch(
        r"reset accepted only \d+ of 40 starts, half are needed: \d+ refused by reset\. The last refusal: "
        r'"hand at .* lies above the reach limit .*"\. Is `spec.workspace` what the arm can reach\?',
        failed["S12"],
    ), failed["S12"]


def test_a_hand_that_is_lower_than_it_says_stops_too_high() -> None:
    check = next(check for check in CHECKS if check.number == "S53")
    message = run_check(check, Bench(backend(Higher))).message
    assert "not grasped" in message or "driven down, the hand stops 0.055 m above the table" in message


def test_where_no_start_is_found_the_message_says_what_was_refused_and_why() -> None:
    bench = Bench(backend(FarWorkspace))
    message = next(run_check(check, bench) for check in CHECKS if check.number == "S6").message
    assert "no start of stage 1 in 200 draws" in message
    assert '200 refused by reset. The last refusal: "hand at ' in message


@pytest.mark.long
@pytest.mark.parametrize("number", NUMBERS)
def test_a_broken_scene_fails_no_other_check_at_all(number: str) -> None:
    assert list(outcomes(list(run_checks(BROKEN[number])), "fail")) == [number]


@pytest.mark.parametrize(
    "left_out",
    [IN_NEW_PROCESSES, pytest.param(frozenset(), marks=pytest.mark.long)],
    ids=["in this process", "in new ones, too"],
)
@pytest.mark.parametrize("name", INTACT)
def test_an_intact_scene_fails_nothing(name: str, left_out: frozenset[str]) -> None:
    backend, inapplicable = INTACT[name]
    bench = Bench(backend)
    results = [run_check(check, bench) for check in CHECKS if check.number not in left_out]
    bench.close()
    assert outcomes(results, "fail") == {}
    assert set(outcomes(results, "not applicable")) == inapplicable
    assert len(outcomes(results, "pass")) == len(CHECKS) - len(inapplicable) - len(left_out)


def test_a_known_gap_is_expected_and_a_closed_one_an_error() -> None:
    gaps = {"S4": "the engine rounds", "S7": "a long story", "S21": "no gravity"}
    results = list(run_checks(dataclasses.replace(BROKEN["S4"], known_gaps=gaps)))
    assert list(outcomes(results, "known gap")) == ["S4"]
    assert outcomes(results, "known gap")["S4"].startswith("the engine rounds (now: spec.control_dt 0.1 s is 3.33")
    assert outcomes(results, "fail") == {
        "S7": "a known gap (a long story), but the check says: pass. Remove it from known_gaps",
        "S21": "a known gap (no gravity), but the check says: not applicable. Remove it from known_gaps",
    }


def test_gaps_must_name_a_number_and_a_reason() -> None:
    with pytest.raises(UnknownNameError, match="unknown number in known_gaps 'S99'"):
        next(run_checks(dataclasses.replace(BROKEN["S4"], known_gaps={"S99": "?"})))
    with pytest.raises(UserError, match="gives no reason"):
        next(run_checks(dataclasses.replace(BROKEN["S4"], known_gaps={"S4": " "})))


def test_names_and_sentences_carry_the_number() -> None:
    for check in CHECKS:
        assert check.test_name.startswith(f"test_s{int(check.number[1:]):02d}_")
        assert check.sentence.endswith(".")


def test_the_documentation_lists_the_same_contract() -> None:
    text = (Path(__file__).parents[2] / "docs" / "conformance.md").read_text()
    lines = re.findall(r"^\*\*(S\d+)\.\*\* (.+)$", text, re.MULTILINE)
    assert lines == [(check.number, check.sentence) for check in CHECKS]
