"""Divide a number of terminals by demand among parts of a tissue or regions of a tree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.errors import GrowthError
from kernels.arrays import FloatArray


def share_terminals(
    demand: FloatArray, least: NDArray[np.int64], terminals: int
) -> NDArray[np.int64]:
    """Share terminals by demand (largest remainders), each part at least its ``least``.

    Raises
    ------
    GrowthError
        When there are fewer than all the least together.
    """
    if terminals < least.sum():
        raise GrowthError(
            f"{terminals} terminals are fewer than the {int(least.sum())} inlets of the tissue's "
            f"parts; ask for {int(least.sum())} or more"
        )
    exact = demand * terminals
    count = np.maximum(np.floor(exact).astype(np.int64), least)
    while count.sum() < terminals:
        count[np.argmax(np.where(demand > 0, exact - count, -np.inf))] += 1
    while count.sum() > terminals:
        count[np.argmin(np.where(count > least, exact - count, np.inf))] -= 1
    return count
