from __future__ import annotations

from importlib import metadata

import pytest

from causalbench.core.kit.versions import require
from causalbench.errors import BrokenVersionError


def pretend(monkeypatch: pytest.MonkeyPatch, **installed: str) -> None:
    """These distributions are installed, and no others."""

    def version(name: str) -> str:
        if name not in installed:
            raise metadata.PackageNotFoundError(name)
        return installed[name]

    monkeypatch.setattr(metadata, "version", version)


@pytest.mark.parametrize("version", ["3.3", "3.3.7", "3.9.12", "3.4.0rc1"])
def test_a_release_inside_its_range_passes(monkeypatch: pytest.MonkeyPatch, version: str) -> None:
    pretend(monkeypatch, engine=version)
    require({"engine": ">=3.3,<3.10"})


@pytest.mark.parametrize("version", ["2.3.7", "3.2.7", "3.10", "3.10.0", "3.17.0", "4.0.0"])
def test_a_release_outside_is_named_with_its_repair(monkeypatch: pytest.MonkeyPatch, version: str) -> None:
    pretend(monkeypatch, other="1.0", engine=version)
    with pytest.raises(BrokenVersionError, match=rf'engine {version}\. Repair: pip install "engine>=3\.3,<3\.10"'):
        require({"other": "==1.0", "engine": ">=3.3,<3.10"})


def test_what_is_missing_is_left_to_the_import(monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch)
    require({"engine": ">=3.3,<3.10"})
