"""The list of backends under test is complete, and all of them work here."""

from __future__ import annotations

from causalbench.plugins import installed


def test_every_backend_is_under_test(backends):
    assert sorted(backends) == sorted(installed().backends)


def test_every_plugin_loads():
    assert {row.distribution: row.error for row in installed().rows if row.error} == {}


def test_the_simulator_is_installed(backend):
    assert installed().problem(backend) == ""
