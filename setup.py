"""What pyproject.toml cannot say: a wheel holds the suites, as `causalbench/suites/`."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class WithSuites(build_py):
    """Copies `suites/` into the package when a wheel is built; an editable install reads them where they lie."""

    def run(self) -> None:
        """Build, then copy."""
        super().run()
        if not self.editable_mode:
            target = Path(self.build_lib) / "causalbench" / "suites"
            target.mkdir(parents=True, exist_ok=True)
            for path in Path(__file__).parent.glob("suites/*.yaml"):
                shutil.copy(path, target)


setup(cmdclass={"build_py": WithSuites})
