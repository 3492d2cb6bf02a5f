"""`python -m causalbench_robosuite.reach_scan` prints the scan behind `WORKSPACE`.

Beyond the rule of `core.kit.reach_scan`, joint 6 stays on the near side of pi, where the axes of joints 5 and 7
are parallel: a tilted hand that passes through there comes out with the forearm turned over. That puts the table high.
"""

from __future__ import annotations

import sys

from causalbench.core.kit.reach_scan import Arm, scan
from causalbench_robosuite.scene import ARM_STARTS, RobosuiteScene
from causalbench_robosuite.world import World

WRIST_HIGH = 3.05  # rad of joint 6

if __name__ == "__main__":
    arm = Arm(World(0.002, n_fixtures=1).chain, ARM_STARTS, lambda joints: bool(joints[5] < WRIST_HIGH))
    for line in scan(arm, RobosuiteScene()):
        sys.stdout.write(line + "\n")
