"""Algorithm 2 of the paper: selection of the causal actions of one reward term from its list of KL divergences."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Selection(NamedTuple):
    """What Algorithm 2 decided and why. `normalised` is the min-max scaled list, whether or not it was used."""

    selected: NDArray[np.bool_]  # (n_actions,)
    cv: float  # coefficient of variation; 0 where the mean is 0
    normalised: NDArray[np.float64]  # (n_actions,)
    threshold: float  # the one that was applied


def select_causal_actions(
    kld: ArrayLike, cv: float = 1.00, normalize: float = 0.10, direct: float = 0.01, ddof: int = 0
) -> Selection:
    """Algorithm 2 on `kld` (n_actions,), with the paper's epsilon_cv, epsilon_normalize and epsilon_direct.

    `ddof=0` is the population deviation, which reproduces every cv of the paper's Table II; `ddof=1` the sample
    deviation, which reproduces four of the five in Table I. A list whose values are all equal selects by
    `direct` alone (its cv is 0). Raises ValueError on an empty list, a NaN or a negative value.
    """
    values = np.asarray(kld, dtype=np.float64)
    if values.ndim != 1 or values.size == 0 or not (np.isfinite(values).all() and (values >= 0).all()):
        raise ValueError(f"expected a non-empty list of finite, non-negative KL divergences, got {values}")
    mean, spread = values.mean(), np.ptp(values)
    variation = float(values.std(ddof=ddof) / mean) if mean > 0 else 0.0
    normalised = (values - values.min()) / spread if spread > 0 else np.zeros_like(values)
    if variation > cv:
        return Selection(normalised > normalize, variation, normalised, normalize)
    return Selection(values > direct, variation, normalised, direct)
