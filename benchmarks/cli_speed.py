"""What `causalbench --help` and `backends` cost with ten plugins: python benchmarks/cli_speed.py (about 30 s).

The plugins are written by `causalbench new-backend` and, as pip would, put on the search path with their metadata, in a
temporary folder. Each figure is the wall time of a whole process. Needs an otherwise idle core.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from causalbench.scaffold import write_backend

PLUGINS, RUNS, LIMIT = 10, 10, 0.5  # s for --help


def install(site: Path, name: str) -> None:
    """Write the plugin of the backend `name`, with the metadata that an installation leaves, into `site`."""
    write_backend(name, site)
    (site / f"{name}_backend" / f"causalbench_{name}").rename(site / f"causalbench_{name}")
    info = site / f"causalbench_{name}-0.1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: causalbench-{name}\nVersion: 0.1.0\n")
    (info / "entry_points.txt").write_text(f"[causalbench]\n{name} = causalbench_{name}\n")


def timed(site: Path, argument: str) -> tuple[float, str]:
    """Seconds that `causalbench argument` takes as a new process, and what it prints."""
    path = os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-m", "causalbench", argument]
    started = time.perf_counter()
    done = subprocess.run(command, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, check=True)
    return time.perf_counter() - started, done.stdout


def main() -> None:
    """Print the least and the median time of each command; fail if `--help` takes too long."""
    with tempfile.TemporaryDirectory() as folder:
        names = [f"speed{i}" for i in range(PLUGINS)]
        for name in names:
            install(Path(folder), name)
        _, listed = timed(Path(folder), "backends")
        if not all(name in listed for name in names):
            sys.exit(f"error: the plugins are not all listed:\n{listed}")
        medians = {}
        for argument in ("--help", "backends"):
            timed(Path(folder), argument)  # writes byte code
            seconds = [timed(Path(folder), argument)[0] for _ in range(RUNS)]
            medians[argument] = statistics.median(seconds)
            print(f"causalbench {argument}: least {min(seconds):.2f} s, median {medians[argument]:.2f} s of {RUNS}")
    if medians["--help"] >= LIMIT:
        sys.exit(f"error: --help takes {medians['--help']:.2f} s, which must be below {LIMIT} s")


if __name__ == "__main__":
    main()
