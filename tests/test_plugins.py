"""Plugins: what an entry point adds, and that one which fails is a row and stops no other."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from causalbench.errors import BackendLoadError, UnknownNameError, UserError
from causalbench.plugins.manager import PluginRow, Plugins, load_plugins

Install = Callable[[str, str], Path]

GOOD = """
from causalbench.plugins.hookspecs import Backend, hookimpl

@hookimpl
def causalbench_backends(register):
    register(Backend("toy", lambda: None, "none", "none", ("sys", "a_simulator_that_is_not_here")))
"""
NOT_IMPORTABLE = "import a_simulator_that_is_not_here"
MISSPELT = GOOD.replace("causalbench_backends", "causalbench_backend").replace('"toy"', '"other"')
TAKEN = GOOD.replace('"toy"', '"kinematic"')
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
    plugins = load(monkeypatch, install("zz-good", GOOD))
    assert PluginRow("zz-good", "1.0") in plugins.rows
    assert plugins.owners["toy"] == PluginRow("zz-good", "1.0")
    assert error_of(plugins, "aa-broken") == "ModuleNotFoundError: No module named 'a_simulator_that_is_not_here'"
    assert "unknown hook 'causalbench_backend'" in error_of(plugins, "bb-misspelt")
    assert error_of(plugins, "cc-taken") == (
        "UserError: backend 'kinematic' is already registered; choose another name"
    )
    assert error_of(plugins, "dd-crashing") == "ZeroDivisionError: division by zero"
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


def test_unknown_names_get_the_nearest_one_and_what_exists() -> None:
    plugins = load_plugins()
    with pytest.raises(UnknownNameError, match=r"unknown backend 'kinematics'. Did you mean 'kinematic'\?"):
        plugins.backend("kinematics")
    with pytest.raises(
        UnknownNameError, match=r"unknown method 'cmmmSAC'. Did you mean 'cmmSAC'\? Known: PPO, SAC, cSAC, "
    ):
        plugins.method("cmmmSAC")
    with pytest.raises(UnknownNameError, match=r"unknown task 'flying'\. Known: mobile_manipulation, pure"):
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
