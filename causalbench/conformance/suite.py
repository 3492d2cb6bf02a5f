"""The contract of a backend: the table of checks of its scenes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from causalbench.conformance.bench import Bench
from causalbench.conformance.check import Check, Result, run_check
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
from causalbench.core.world.scene import ARM_ACTIONS
from causalbench.errors import UnknownNameError, UserError
from causalbench.plugins.backends import NO_OPTIONS, Backend

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
    Check(contact.s54_self_collision, (Capability.PHYSICS, *ARM_ACTIONS)),
)
"""The contract, in the order of its numbers."""


def check_gaps(gaps: Mapping[str, str]) -> None:
    """Raise `UserError` when known gaps name a number that does not exist, or give no reason."""
    numbers = [check.number for check in CHECKS]
    for number, reason in gaps.items():
        if number not in numbers:
            raise UnknownNameError("number in known_gaps", number, numbers)
        if not reason.strip():
            raise UserError(f"known_gaps[{number!r}] gives no reason")


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
