"""`python -m causalbench_gymrob.reach_scan` prints the scan behind the `WORKSPACE` of Fetch.

Beyond the rule of the kit's `reach_scan`, the hand starts no higher than the upper arm stays clear of the head on the
way down.
"""

from __future__ import annotations

import sys

from causalbench.backend import fetch, reach_demands
from causalbench.core.kit.reach_scan import Arm, scan
from causalbench_gymrob.scene import GymrobScene

if __name__ == "__main__":
    scene = GymrobScene()
    for line in scan(Arm(scene.world.chain, fetch.ARM_STARTS), scene, reach_demands.PURE_MANIPULATION):
        sys.stdout.write(line + "\n")
