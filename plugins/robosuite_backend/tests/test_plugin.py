from __future__ import annotations

from importlib import metadata

import pytest

import causalbench_robosuite
from causalbench.backend import Backend, BrokenVersionError
from causalbench_robosuite import make


def test_it_registers_one_backend() -> None:
    backends: list[Backend] = []
    causalbench_robosuite.causalbench_backends(backends.append)
    assert [(b.name, b.engine) for b in backends] == [("robosuite", "MuJoCo")]
    assert [variant.robot for variant in backends[0].variants] == ["Panda", "PandaOmron"]


@pytest.mark.parametrize("version", ["2.3.7", "3.2.7", "3.4.0", "3.10.0", "3.17.0", "4.0.0"])
def test_a_broken_mujoco_is_named_with_its_repair(monkeypatch: pytest.MonkeyPatch, version: str) -> None:
    monkeypatch.setattr(metadata, "version", lambda name: version if name == "mujoco" else "1.5.2")
    with pytest.raises(BrokenVersionError, match=rf'mujoco {version}.*pip install "mujoco==3\.3\.\*"'):
        make()


def test_another_robosuite_is_named_with_its_repair(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metadata, "version", lambda name: "3.3.7" if name == "mujoco" else "1.4.1")
    with pytest.raises(BrokenVersionError, match=r'1\.4\.1.*pip install "robosuite==1\.5\.2"'):
        make()
