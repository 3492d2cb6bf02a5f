"""What a scene says about itself."""

from __future__ import annotations

import numpy as np

from causalbench.conformance.bench import Bench, expect
from causalbench.core.world.capabilities import SCENE_CAPABILITIES, Capability
from causalbench.core.world.scene import ACTION_SPEED
from causalbench.errors import CausalbenchError


def s01_names(bench: Bench) -> None:
    """S1. `spec.backend` and `spec.robot` are as registered, nothing is empty, and all scenes have equal specs."""
    spec = bench.spec
    expect(
        spec.backend == bench.backend.name,
        f"spec.backend is {spec.backend!r}, but the plugin registers {bench.backend.name!r}",
    )
    expect(
        spec.robot == bench.variant.robot,
        f"spec.robot is {spec.robot!r}, but the plugin registers {bench.variant.robot!r} for these options",
    )
    for name in ("backend_version", "engine", "engine_version", "robot"):
        value = getattr(spec, name)
        expect(isinstance(value, str) and value.strip(), f"spec.{name} is {value!r}, not a name")
    other = bench.make().spec
    expect(other == spec, f"two scenes made alike have different specs: {spec} and {other}")


def s02_actions(bench: Bench) -> None:
    """S2. Actions are known, in the project's order and not repeated; each declares a positive speed."""
    actions, speeds = bench.spec.actions, bench.spec.action_speed
    unknown = [name for name in actions if name not in ACTION_SPEED]
    expect(not unknown, f"unknown actions {unknown}; known: {', '.join(ACTION_SPEED)}")
    ordered = tuple(name for name in ACTION_SPEED if name in actions)
    expect(actions == ordered, f"spec.actions is {actions}, expected the order {ordered}")
    expect(len(speeds) == len(actions), f"{len(speeds)} action speeds for {len(actions)} actions")
    bad = {name: speed for name, speed in zip(actions, speeds, strict=True) if not 0 < speed < np.inf}
    expect(not bad, f"speeds must be positive and finite: {bad}")


def s03_workspace(bench: Bench) -> None:
    """S3. The workspace's boxes are not empty, the hand's lies above the table, and the gripper opens."""
    w = bench.spec.workspace
    for name, low, high in (("object", w.object_low, w.object_high), ("hand", w.hand_low, w.hand_high)):
        expect(
            len(low) == len(high) and all(a < b for a, b in zip(low, high, strict=True)),
            f"workspace.{name}_low {low} must lie below workspace.{name}_high {high} in every coordinate",
        )
    expect(w.table_height > 0, f"workspace.table_height is {w.table_height} m")
    expect(w.hand_low[2] > w.table_height, f"the hand may start at {w.hand_low[2]} m, in a table of {w.table_height} m")
    expect(bench.spec.max_opening > 0, f"spec.max_opening is {bench.spec.max_opening} m")


def s04_time(bench: Bench) -> None:
    """S4. `control_dt` is a whole number of timesteps."""
    spec = bench.spec
    expect(spec.timestep > 0, f"spec.timestep is {spec.timestep} s")
    ratio = spec.control_dt / spec.timestep
    expect(
        round(ratio) >= 1 and abs(ratio - round(ratio)) < 1e-6,
        f"spec.control_dt {spec.control_dt} s is {ratio:g} timesteps of {spec.timestep} s",
    )


def s05_capabilities(bench: Bench) -> None:
    """S5. Capabilities are known ones, the same that the plugin registers, and truthful.

    The base actions, `workspace.carry` and `MOBILE_BASE` go together, as do `lidar_position` and `LIDAR`, and no
    `EXACT_RESTORE` and a `restore_error` above 0; `render` and `lidar` raise without `RGB` and `LIDAR`.
    """
    spec = bench.spec
    unknown = sorted(spec.capabilities - SCENE_CAPABILITIES)
    expect(not unknown, f"unknown capabilities {unknown}; known: {', '.join(sorted(SCENE_CAPABILITIES))}")
    registered = bench.variant.capabilities
    expect(
        spec.capabilities == registered,
        f"spec.capabilities is {sorted(spec.capabilities)}, but the plugin registers {sorted(registered)}",
    )
    mobile = {"forward", "turn"} <= set(spec.actions)
    expect(
        mobile == (Capability.MOBILE_BASE in spec.capabilities),
        f"the actions forward and turn and the capability {Capability.MOBILE_BASE!r} go together; "
        f"actions: {spec.actions}",
    )
    exact = Capability.EXACT_RESTORE in spec.capabilities
    expect(
        spec.restore_error == 0 if exact else 0 < spec.restore_error < np.inf,
        f"spec.restore_error is {spec.restore_error} {'with' if exact else 'without'} "
        f"the capability {Capability.EXACT_RESTORE!r}; it is 0 with it, and without it "
        "how far facts may be off after a restore",
    )
    for capability, where in ((Capability.MOBILE_BASE, "workspace.carry"), (Capability.LIDAR, "lidar_position")):
        owner = spec.workspace if where.startswith("workspace") else spec
        declared = getattr(owner, where.rpartition(".")[2]) is not None
        expect(
            declared == (capability in spec.capabilities), f"spec.{where} and the capability {capability!r} go together"
        )
    optional = {Capability.RGB: lambda: bench.scene.render(64, 48), Capability.LIDAR: bench.scene.lidar}
    for capability, call in optional.items():
        if capability in spec.capabilities:
            continue
        try:
            call()
        except CausalbenchError:
            continue
        raise AssertionError(f"without the capability {capability!r} the call must raise a CausalbenchError")
