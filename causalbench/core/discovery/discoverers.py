"""The discoverers that come with causalbench."""

from __future__ import annotations

from collections.abc import Mapping

from causalbench.core.discovery.methods import (
    ace,
    cai,
    cmi,
    hrt,
    ibd,
    independence,
    paired,
    permutation,
    sufficient,
)
from causalbench.core.discovery.methods.anytime import method as anytime
from causalbench.core.discovery.methods.kl import method as kl
from causalbench.core.discovery.registry import Discoverer

DISCOVERERS: Mapping[str, Discoverer] = {
    row.name: row
    for row in (
        kl.DISCOVERER,
        anytime.DISCOVERER,
        paired.DISCOVERER,
        sufficient.DISCOVERER,
        permutation.DISCOVERER,
        cmi.DISCOVERER,
        cai.DISCOVERER,
        hrt.DISCOVERER,
        ibd.DISCOVERER,
        ace.DISCOVERER,
        independence.FISHER_Z,
        independence.KCI,
    )
}
"""By name, the paper's first."""
