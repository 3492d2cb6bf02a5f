"""The table of checks, and the one function that runs them for both runners."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from causalbench.conformance.bench import Bench
from causalbench.conformance.checks import (
    contact,
    copies,
    drive,
    facts,
    life,
    motion,
    objects,
    repeat,
    reset,
    rgb,
    solve,
    spec,
)
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.scene import ARM_ACTIONS, SceneSpec
from causalbench.errors import UnknownNameError, UserError
from causalbench.plugins.backends import NO_OPTIONS, Backend

PASS, FAIL, GAP, NOT_APPLICABLE = "pass", "fail", "known gap", "not applicable"


@dataclass(frozen=True)
class Check:
    """One numbered line of the contract. `needs`: actions and capabilities without which it does not apply."""

    function: Callable[[Bench], None]
    needs: tuple[str, ...] = ()

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

    def missing(self, spec: SceneSpec) -> list[str]:
        """What a scene of `spec` lacks for this check to apply."""
        return [name for name in self.needs if name not in spec.capabilities and name not in spec.actions]


MOBILE = (Capability.MOBILE_BASE,)

CHECKS = (
    Check(spec.s01_names),
    Check(spec.s02_actions),
    Check(spec.s03_workspace),
    Check(spec.s04_time),
    Check(spec.s05_capabilities),
    Check(facts.s06_types),
    Check(facts.s07_quaternions),
    Check(facts.s08_copies, ("armz", "grip")),
    Check(reset.s09_layout),
    Check(reset.s10_base_elsewhere),
    Check(reset.s11_out_of_reach),
    Check(reset.s12_no_contact),
    Check(motion.s13_translations, ("armx", "army", "armz")),
    Check(motion.s14_rotations, ("armrx", "armry", "armrz")),
    Check(motion.s15_grip, ("grip",)),
    Check(motion.s16_base, MOBILE),
    Check(motion.s17_half, ("armx", "army", "armz")),
    Check(motion.s18_one_control_dt, ("army",)),
    Check(motion.s19_idle),
    Check(motion.s20_grip_zero, ("grip",)),
    Check(motion.s21_gravity, (Capability.PHYSICS, "army", "armz", "grip")),
    Check(motion.s22_invalid_actions),
    Check(motion.s23_finite),
    Check(contact.s24_collision, ("armz",)),
    Check(contact.s25_clear, ARM_ACTIONS),
    Check(contact.s26_holding, ("grip",)),
    Check(repeat.s27_deterministic),
    Check(repeat.s28_new_process),
    Check(repeat.s29_independent),
    Check(repeat.s30_snapshot_free),
    Check(repeat.s31_snapshot_contact, ("armz",)),
    Check(repeat.s32_snapshot_grasp, ("grip",)),
    Check(repeat.s33_snapshot_new_process, ("armz", "grip")),
    Check(repeat.s34_foreign_bytes),
    Check(life.s35_close),
    Check(life.s36_imports),
    Check(life.s37_spawn),
    Check(solve.s38_expert, ARM_ACTIONS),
    Check(solve.s39_lift, ARM_ACTIONS),
    Check(drive.s40_room, MOBILE),
    Check(drive.s41_arc, MOBILE),
    Check(drive.s42_base_velocity, MOBILE),
    Check(drive.s43_lidar, (Capability.LIDAR,)),
    Check(drive.s44_lidar_fixtures_only, (*MOBILE, Capability.LIDAR)),
    Check(drive.s45_base_collision, MOBILE),
    Check(drive.s46_snapshot_drive, MOBILE),
    Check(drive.s47_mobile_expert, (*MOBILE, *ARM_ACTIONS)),
    Check(rgb.s48_picture, (Capability.RGB,)),
    Check(objects.s49_several_objects, ARM_ACTIONS),
    Check(copies.s50_copies, ARM_ACTIONS),
    Check(copies.s51_picture_in_a_thread, (Capability.RGB,)),
    Check(copies.s52_picture_after_a_fork, (Capability.RGB,)),
    Check(contact.s53_hand_in_the_world, ("armz", "grip")),
)
"""The contract, in the order of its numbers."""


@dataclass(frozen=True)
class Result:
    """What one check found. `message` says what is wrong, why it does not apply, or why it is a known gap."""

    number: str
    sentence: str
    outcome: str
    message: str
    seconds: float
    place: str  # file:line of the check


def check_gaps(gaps: Mapping[str, str]) -> None:
    """Raise `UserError` when known gaps name a number that does not exist, or give no reason."""
    numbers = [check.number for check in CHECKS]
    for number, reason in gaps.items():
        if number not in numbers:
            raise UnknownNameError("number in known_gaps", number, numbers)
        if not reason.strip():
            raise UserError(f"known_gaps[{number!r}] gives no reason")


def run_check(check: Check, bench: Bench) -> Result:
    """Run one check; a known gap of the backend turns a failure into a gap, and anything else into a failure."""
    started = time.perf_counter()
    gap = bench.backend.known_gaps.get(check.number)
    missing = check.missing(bench.spec)
    if missing:
        outcome, message = NOT_APPLICABLE, f"needs {', '.join(missing)}, which the spec does not declare"
    else:
        message = _failure(check, bench)
        outcome = FAIL if message else PASS
    if gap is not None:
        if outcome == FAIL:
            outcome, message = GAP, f"{gap} (now: {message})"
        else:
            outcome, message = FAIL, f"a known gap ({gap}), but the check says: {outcome}. Remove it from known_gaps"
    return Result(check.number, check.sentence, outcome, message, time.perf_counter() - started, check.place)


def _failure(check: Check, bench: Bench) -> str:
    try:
        check.function(bench)
    except AssertionError as error:
        return str(error) or "an assertion without a message failed in the plugin"
    except Exception as error:  # a stranger's code may raise anything
        return f"{type(error).__name__}: {error}"
    return ""


def run_checks(backend: Backend, options: Mapping[str, Any] = NO_OPTIONS) -> Iterator[Result]:
    """Run the whole contract, one result after the other.

    Raises `UserError` for wrong `known_gaps` and `CausalbenchError` when no scene can be made.
    """
    check_gaps(backend.known_gaps)
    bench = Bench(backend, options)
    try:
        for check in CHECKS:
            yield run_check(check, bench)
    finally:
        bench.close()
