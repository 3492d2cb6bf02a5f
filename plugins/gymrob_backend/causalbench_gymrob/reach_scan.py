"""`python -m causalbench_gymrob.reach_scan` prints the scan behind Fetch's `WORKSPACE`.

Beyond the rule of `core.kit.reach_scan`, the hand starts no higher than the upper arm stays clear of the head
on the way down.
"""

from __future__ import annotations

import sys

from causalbench.core.kit.reach_scan import Arm, scan
from causalbench.core.kit.robots.fetch import ARM_STARTS
from causalbench_gymrob.scene import GymrobScene
from causalbench_gymrob.world import World

if __name__ == "__main__":
    for line in scan(Arm(World(0.005, n_fixtures=1).chain, ARM_STARTS), GymrobScene()):
        sys.stdout.write(line + "\n")
