"""Which of several heads writes which vessel, by what the recipe says of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from design.network import VesselKind, VesselNetwork
from printctl.errors import UsageError
from printctl.recipe.heads import HeadPart

IntArray = NDArray[np.int64]
_NOBODY = -1


def vessel_heads(network: VesselNetwork, heads: Sequence[HeadPart]) -> IntArray:
    """Head of each vessel, (v,).

    A head's `trees` count before any head's `kinds`; what nobody names the head writes that names
    nothing, or the first one where none names anything.

    Parameters
    ----------
    network : VesselNetwork
    heads : sequence of HeadPart
        Empty for a printer with one.

    Raises
    ------
    UsageError
        For a vessel that no head is to write.
    """
    if all(head.writes_the_rest for head in heads):
        return np.zeros(len(network.kind), dtype=np.int64)
    found = np.full(len(network.kind), _NOBODY, dtype=np.int64)
    for number, head in enumerate(heads):
        kinds = [int(VesselKind[kind.upper()]) for kind in head.kinds]
        found[np.isin(network.kind, kinds)] = number
    for number, head in enumerate(heads):
        found[np.isin(network.tree, list(head.trees))] = number
    rest = next((k for k, head in enumerate(heads) if head.writes_the_rest), _NOBODY)
    found[found == _NOBODY] = rest
    nobody = np.flatnonzero(found == _NOBODY)
    if len(nobody):
        vessel = int(nobody[0])
        kind = VesselKind(int(network.kind[vessel])).name.lower()
        raise UsageError(
            f"vessel {vessel} ({kind}, tree {int(network.tree[vessel])}) is written by no head, "
            f"nor are {len(nobody) - 1} more; name its kind or tree in printer.heads, or let one "
            "head name neither: it writes the rest"
        )
    return found
