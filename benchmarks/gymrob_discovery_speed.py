"""A whole discovery of pure manipulation on gymrob, collection included, at the default settings on two cores.

    python benchmarks/gymrob_discovery_speed.py

Times the command as a user calls it, interpreter and imports included, once. The goal is three minutes.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time

CORES, GOAL = 2, 180.0


def main() -> None:
    """Run it and print the seconds."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["discover", "--backend", "gymrob", "--jobs", str(CORES), "--out", folder]
        started = time.perf_counter()
        subprocess.run([sys.executable, "-m", "causalbench", *arguments], check=True, stdout=subprocess.DEVNULL)
        seconds = time.perf_counter() - started
    print(f"discovery on gymrob, {CORES} processes that collect: {seconds:.0f} s (goal {GOAL:.0f} s)")


if __name__ == "__main__":
    main()
