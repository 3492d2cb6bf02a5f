"""Plugins: what an entry point adds, and that one which fails is a row and stops no other."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from causalbench.core.tasks.mobile_manipulation import TASK as MOBILE_MANIPULATION
from causalbench.core.tasks.pure_manipulation import TASK as PURE_MANIPULATION
from causalbench.core.world.capabilities import Capability
from causalbench.errors import BackendLoadError, UnknownNameError, UserError
from causalbench.plugins.backends import Backend, Variant
from causalbench.plugins.manager import PluginRow, Plugins, load_plugins
from causalbench.plugins.venues import venue_of, worlds_maker

Install = Callable[[str, str], Path]

GOOD = """
from causalbench.plugins.backends import Backend, Variant
from causalbench.plugins.hookspecs import hookimpl

@hookimpl
def causalbench_backends(register):
    register(Backend("toy", lambda: None, "none", (Variant("none"),), ("sys", "a_simulator_that_is_not_here")))
"""
NOT_IMPORTABLE = "import a_simulator_that_is_not_here"
MISSPELT = GOOD.replace("causalbench_backends", "causalbench_backend").replace('"toy"', '"other"')
TAKEN = GOOD.replace('"toy"', '"kinematic"')
LEAVING = "import sys; sys.exit(0)"
CRASHING = GOOD.replace("register(", "register(1 / 0, ")


def load(monkeypatch: pytest.MonkeyPatch, site: Path) -> Plugins:
    monkeypatch.syspath_prepend(site)
    return load_plugins()


def error_of(plugins: Plugins, distribution: str) -> str:
    return next(row.error for row in plugins.rows if row.distribution == distribution)


def test_the_built_ins_register_through_the_same_hooks() -> None:
    plugins = load_plugins()
    assert plugins.backend("kinematic").make().spec.backend == "kinematic"
    assert plugins.task("pure_manipulation").name == "pure_manipulation"
    assert plugins.method("cmSAC").matrix == "discovered"
    assert plugins.owners["kinematic"].distribution == "causalbench-robotics"


def test_broken_plugins_are_rows_and_the_good_ones_load(install: Install, monkeypatch: pytest.MonkeyPatch) -> None:
    install("aa-broken", NOT_IMPORTABLE)
    install("bb-misspelt", MISSPELT)
    install("cc-taken", TAKEN)
    install("dd-crashing", CRASHING)
    install("ee-leaving", LEAVING)
    plugins = load(monkeypatch, install("zz-good", GOOD))
    assert PluginRow("zz-good", "1.0", "zz_good") in plugins.rows
    assert plugins.owners["toy"] == PluginRow("zz-good", "1.0", "zz_good")
    assert error_of(plugins, "aa-broken") == "ModuleNotFoundError: No module named 'a_simulator_that_is_not_here'"
    assert "unknown hook 'causalbench_backend'" in error_of(plugins, "bb-misspelt")
    assert error_of(plugins, "cc-taken") == (
        "UserError: backend 'kinematic' is already registered; choose another name"
    )
    assert error_of(plugins, "dd-crashing") == "ZeroDivisionError: division by zero"
    assert error_of(plugins, "ee-leaving") == "SystemExit: 0"
    assert "other" not in plugins.backends
    assert plugins.owners["kinematic"].distribution == "causalbench-robotics"


def test_a_backend_without_its_simulator_names_the_install_command(
    install: Install, monkeypatch: pytest.MonkeyPatch
) -> None:
    plugins = load(monkeypatch, install("zz-good", GOOD))
    with pytest.raises(BackendLoadError) as caught:
        plugins.backend("toy")
    assert str(caught.value) == (
        "backend 'toy' needs a_simulator_that_is_not_here, not installed here; run: pip install zz-good"
    )


def test_a_backend_whose_plugin_is_broken_says_so(install: Install, monkeypatch: pytest.MonkeyPatch) -> None:
    plugins = load(monkeypatch, install("causalbench-newsim", NOT_IMPORTABLE))
    with pytest.raises(
        BackendLoadError, match=r"backend 'newsim': its plugin causalbench-newsim 1.0 could not be loaded"
    ):
        plugins.backend("newsim")


@pytest.mark.parametrize(
    ("distribution", "wanted"),
    [("causalbench-newsim", "new"), ("causalbench-newsim", "sim"), ("causalbench-newsim", "causalbench")],
)
def test_a_broken_plugin_is_not_blamed_for_a_name_that_is_part_of_its_own(
    install: Install, monkeypatch: pytest.MonkeyPatch, distribution: str, wanted: str
) -> None:
    plugins = load(monkeypatch, install(distribution, NOT_IMPORTABLE))
    with pytest.raises(UnknownNameError, match=f"unknown backend '{wanted}'.* Could not be loaded: .*{distribution}"):
        plugins.backend(wanted)


@pytest.mark.parametrize("row", [
    PluginRow("causalbench-new-sim", "1", "x"), PluginRow("CausalBench_New.Sim", "1", "x"),
    PluginRow("new_sim", "1", "x"), PluginRow("acme-robots", "1", "new_sim"),
])  # fmt: skip
def test_a_plugin_is_called_after_its_backend_by_its_entry_point_or_distribution(row: PluginRow) -> None:
    assert row.may_register("new_sim")
    assert not row.may_register("new")
    assert not row.may_register("sim")


def named(name: str) -> str:
    """A distribution of its own, since a module of that name stays imported."""
    return f"zz-named-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


@pytest.mark.parametrize(
    "name", ["", ".", "..", "a/b", "../up", "a\\b", "-v", ".hidden", "end.", "a b", "é", "n" * 65, "a\n"]
)
def test_a_name_that_is_no_file_name_is_the_plugins_error(
    install: Install, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    plugins = load(monkeypatch, install(named(name), GOOD.replace('"toy"', repr(name))))
    assert f"backend {name!r}: a name is 1 to 64 letters, digits, '_', '-' and '.'" in error_of(plugins, named(name))
    assert name not in plugins.backends


@pytest.mark.parametrize("name", ["a", "n" * 64, "Sim-2.1_x", "2d"])
def test_other_names_are_registered(install: Install, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    assert name in load(monkeypatch, install(named(name), GOOD.replace('"toy"', repr(name)))).backends


def test_every_built_in_name_is_one() -> None:
    assert [row.error for row in load_plugins().rows if row.distribution == "causalbench-robotics"] == [""]


def make_arm(hz: float = 10.0, mobile: bool = False, tall: bool = False) -> Any:
    return (hz, mobile, tall)


STANDS, DRIVES = frozenset({Capability.RGB}), frozenset({Capability.RGB, Capability.LIDAR, Capability.MOBILE_BASE})
ARM = Backend("arm", make_arm, "none", (
    Variant("standing", STANDS), Variant("driving", DRIVES, {"mobile": True}),
    Variant("tall", DRIVES, {"mobile": True, "tall": True}),
))  # fmt: skip


@pytest.mark.parametrize(("options", "robot"), [
    ({}, "standing"), ({"mobile": False, "hz": 20}, "standing"), ({"mobile": True}, "driving"),
    ({"mobile": True, "tall": True, "hz": 5}, "tall"), ({"tall": True}, "standing"),
])  # fmt: skip
def test_the_variant_is_the_one_with_most_of_the_options(options: dict[str, Any], robot: str) -> None:
    assert ARM.variant(options).robot == robot
    assert ARM.maker(options)() == make_arm(**options)


def test_whether_a_task_can_run_is_known_without_a_scene() -> None:
    backend = dataclasses.replace(ARM, make=lambda hz=10.0, mobile=False, tall=False: 1 / 0)
    pure, mobile = venue_of(PURE_MANIPULATION), venue_of(MOBILE_MANIPULATION)
    assert pure.refusal(backend) == ""
    assert mobile.refusal(backend) == ""
    assert mobile.refusal(backend, {"mobile": False}) == (
        "backend 'arm' cannot run task 'mobile_manipulation': its robot (standing) lacks lidar, mobile_base; "
        "`causalbench backends` lists what each can do"
    )
    only = dataclasses.replace(ARM, make=lambda: None, variants=ARM.variants[:1])
    assert "options of backend 'arm': got an unexpected keyword argument 'mobile'" in mobile.refusal(only)
    without = Backend("gym", None, "Gymnasium")
    assert pure.refusal(without) == (
        "backend 'gym' cannot run task 'pure_manipulation': backend 'gym' makes no scenes: its tasks bring their "
        "environments along"
    )


def test_options_that_make_does_not_take_are_named_with_those_that_exist() -> None:
    with pytest.raises(UserError, match=r"options of backend 'arm': .*'speed'; it takes hz=10.0, mobile=False, tall"):
        worlds_maker(ARM, PURE_MANIPULATION, {"speed": 1})


@pytest.mark.parametrize("variants", [(), ARM.variants[1:], (*ARM.variants, Variant("flying", STANDS, {"wings": 2}))])
def test_variants_that_make_cannot_make_are_refused_at_once(variants: tuple[Variant, ...]) -> None:
    with pytest.raises(UserError, match=r"backend 'arm'"):
        dataclasses.replace(ARM, variants=variants)


def test_unknown_names_get_the_nearest_one_and_what_exists() -> None:
    plugins = load_plugins()
    with pytest.raises(UnknownNameError, match=r"unknown backend 'kinematics'. Did you mean 'kinematic'\?"):
        plugins.backend("kinematics")
    with pytest.raises(
        UnknownNameError, match=r"unknown method 'cmmmSAC'. Did you mean 'cmmSAC'\? Known: PPO, SAC, cSAC, "
    ):
        plugins.method("cmmmSAC")
    with pytest.raises(UnknownNameError, match=r"unknown task 'flying'\. Known: .*mobile_manipulation, "):
        plugins.task("flying")


DISCOVERING = """
from causalbench.core.discovery.registry import Discoverer
from causalbench.plugins.hookspecs import hookimpl

@hookimpl
def causalbench_discoverers(register):
    register(Discoverer("guess", lambda problem: None, "for a test"))
    register(Discoverer("lacking", lambda problem: None, "a test", modules=("a_library_not_here",), extra="acme[lib]"))
"""


def test_discoverers_come_through_a_hook_and_name_what_they_lack(
    install: Install, monkeypatch: pytest.MonkeyPatch
) -> None:
    plugins = load(monkeypatch, install("zz-discovering", DISCOVERING))
    assert plugins.discoverer("kl").name == "kl"
    assert plugins.discoverer("guess").about == "for a test"
    with pytest.raises(UserError, match=r"'lacking' needs a_library_not_here, .* run: pip install 'acme\[lib\]'"):
        plugins.discoverer("lacking")
    with pytest.raises(UnknownNameError, match=r"unknown discoverer 'gues'\. Did you mean 'guess'\?"):
        plugins.discoverer("gues")
