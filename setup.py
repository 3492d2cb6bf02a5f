"""What pyproject.toml cannot say: a wheel holds suites, documentation and examples, below `causalbench/`."""

import re
import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).parent
TREES = {
    "suites": ["*.yaml"],
    "docs": ["*.md", "*.svg", "*.png", "*.gif"],
    "examples": ["*.md", "*.py", "*.toml", "*.yaml", "*.xml", "*.ipynb"],
    "studies": ["*.md", "*.py", "*.yaml", "*.sh"],
    ".": ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "LICENSE"],
}
"""Folder -> names of the files that go along; "." is the top of the checkout alone."""


def files() -> list[Path]:
    """All of them, relative to the checkout."""
    found = [
        path for tree, names in TREES.items() if tree != "." for name in names for path in (ROOT / tree).rglob(name)
    ]
    return [path.relative_to(ROOT) for path in [*found, *(ROOT / name for name in TREES["."])]]


def in_the_package(text: str) -> str:
    """A page as it stands in `causalbench/docs/`: links to modules leave out the package, which is now above it."""
    return re.sub(r"(\]\((?:\.\./)+)causalbench/", r"\1", text)


class WithPages(build_py):
    """Copies them into the package when a wheel is built; an editable install reads them where they lie."""

    def run(self) -> None:
        """Build, then copy."""
        super().run()
        for path in [] if self.editable_mode else files():
            target = Path(self.build_lib) / "causalbench" / path
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / path, target)
            if path.suffix == ".md":
                target.write_text(in_the_package(target.read_text(encoding="utf-8")), encoding="utf-8")


setup(cmdclass={"build_py": WithPages})
