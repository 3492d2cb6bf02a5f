from __future__ import annotations

from importlib import metadata

import pytest

import causalbench_gymrob
from causalbench.backend import Backend, BrokenVersionError
from causalbench_gymrob import make


def test_it_registers_one_backend() -> None:
    backends: list[Backend] = []
    causalbench_gymrob.causalbench_backends(backends.append)
    assert [(b.name, b.engine) for b in backends] == [("gymrob", "MuJoCo")]
    assert [variant.robot for variant in backends[0].variants] == ["Fetch", "Fetch"]


@pytest.mark.parametrize("version", ["2.3.7", "3.2.7", "3.10.0", "3.17.0", "4.0.0"])
def test_a_broken_mujoco_is_named_with_its_repair(monkeypatch: pytest.MonkeyPatch, version: str) -> None:
    monkeypatch.setattr(metadata, "version", lambda name: version if name == "mujoco" else "1.4.2")
    with pytest.raises(BrokenVersionError, match=rf'mujoco {version}.*pip install "mujoco>=3\.3,<3\.10"'):
        make()


def test_another_gymnasium_robotics_is_named_with_its_repair(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metadata, "version", lambda name: "3.3.7" if name == "mujoco" else "1.5.0")
    with pytest.raises(BrokenVersionError, match=r'1\.5\.0.*pip install "gymnasium-robotics==1\.4\.2"'):
        make()
