"""Do training processes slow each other down? python benchmarks/side_by_side_speed.py (a minute, two idle cores).

Updates per second of mSAC's agent (256-256, batch 256), wall clock: one process alone, then two at once, with one torch
thread each, as cells run, and with two, which is what torch takes by itself on two cores.
"""

from __future__ import annotations

import multiprocessing
import time

import torch
from sac_speed import ours

SECONDS = 8.0


def rate(threads: int, start: float) -> float:
    """Updates per second of this process from the instant `start` of the machine's clock on."""
    torch.set_num_threads(threads)
    train = ours("mSAC", 1, (256, 256), 256)
    train(5)
    time.sleep(max(0.0, start - time.time()))
    done, began = 0, time.perf_counter()
    while time.perf_counter() - began < SECONDS:
        train(5)
        done += 5
    return done / (time.perf_counter() - began)


def rates(processes: int, threads: int) -> list[float]:
    """Of as many processes at once."""
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        return pool.starmap(rate, [(threads, time.time() + 12.0)] * processes)


def main() -> None:
    """Print a line per number of threads."""
    for threads in (1, 2):
        (alone,), together = rates(1, threads), rates(2, threads)
        print(
            f"{threads} thread(s) a process: {alone:.0f} updates/s alone, {' and '.join(f'{r:.0f}' for r in together)} "
            f"side by side, together {sum(together) / alone:.2f} times one alone"
        )


if __name__ == "__main__":
    main()
