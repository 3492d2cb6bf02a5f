"""`python -m causalbench_robosuite.reach_scan` prints the scan behind `WORKSPACE`.

Beyond the rule of the kit's `reach_scan`, joint 6 stays on the near side of pi, where the axes of joints 5 and 7
are parallel: a tilted hand that passes through there comes out with the forearm turned over. That puts the table high.
"""

from __future__ import annotations

import sys

from causalbench.backend import reach_demands
from causalbench.core.kit.reach_scan import Arm, scan
from causalbench_robosuite.scene import ARM_STARTS, RobosuiteScene

WRIST_HIGH = 3.05  # rad of joint 6

if __name__ == "__main__":
    scene = RobosuiteScene()
    arm = Arm(scene.world.chain, ARM_STARTS, lambda joints: bool(joints[5] < WRIST_HIGH))
    for line in scan(arm, scene, reach_demands.PURE_MANIPULATION):
        sys.stdout.write(line + "\n")
