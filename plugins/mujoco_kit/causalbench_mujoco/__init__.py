"""What backends over MuJoCo share: a scene to fill in, pictures, LiDAR, contacts, boxes and bases that drive.

No backend itself. Importing this imports no simulator; its modules do.
"""

from __future__ import annotations

__version__ = "0.1.0"

RELEASES = ">=3.3,<3.10"
"""Releases of mujoco that all of this works with, see `causalbench.backend.require`."""
