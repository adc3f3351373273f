"""Layer status in a scan: printed, partly seen, under way, not printed, missing, not seen."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import Final

import numpy as np

from registration.overlay.measure import LayerNumbers

LEAST_SEEN: Final = 0.1
"""Of the written area; of a layer of which less is seen nothing is said."""
MOSTLY_SEEN: Final = 0.9
AGREED: Final = 0.95
"""Of the seen written area of a layer under way: gel before its last line, none behind."""
LEAST_REST: Final = 0.03
"""Of a layer's seen written area; a rest smaller than this isn't told from a gap."""
LEAST_GEL: Final = 0.1
"""Of the seen written area; a layer that shows less isn't there."""


class LayerStatus(StrEnum):
    """Of one layer in one scan."""

    PRINTED = "printed"
    PARTLY_SEEN = "partly seen"
    """Gel is there, and part of the layer is out of view or unlit."""
    UNDER_WAY = "under way"
    """The topmost with gel, written up to one of its lines and without gel from there on."""
    NOT_SEEN = "not seen"
    """Out of view or unlit: neither there nor missing."""
    NOT_PRINTED = "not printed"
    """In view and no gel, nor any above it: not yet printed when it was scanned."""
    MISSING = "missing"
    """In view and no gel, although layers above it have some."""

    @property
    def judged(self) -> bool:
        """Whether its gaps and blobs mean anything."""
        return self not in (LayerStatus.NOT_SEEN, LayerStatus.NOT_PRINTED)


def statuses(numbers: Sequence[LayerNumbers]) -> list[LayerStatus]:
    """Of all layers of a job, the lowest first."""
    layers = []
    gel_above = False
    for one in reversed(numbers):
        status = _status(one, gel_above)
        gel_above |= status in (LayerStatus.PRINTED, LayerStatus.PARTLY_SEEN)
        layers.append(status)
    return layers[::-1]


def _status(one: LayerNumbers, gel_above: bool) -> LayerStatus:
    if one.seen < LEAST_SEEN or one.gel_in_written is None:
        return LayerStatus.NOT_SEEN
    if one.gel_in_written < LEAST_GEL:
        return LayerStatus.MISSING if gel_above else LayerStatus.NOT_PRINTED
    return LayerStatus.PRINTED if one.seen >= MOSTLY_SEEN else LayerStatus.PARTLY_SEEN


def reached(one: LayerNumbers) -> int | None:
    """How many of a layer's moves were made when it was scanned, if it broke off.

    The count that fits best: gel in all bands before it, none from there on. None where the whole
    layer was written, or where gel and no gel don't follow the order of writing (gaps do not).
    """
    seen, gel = one.move_seen, one.move_gel
    before = np.concatenate([[0], np.cumsum(gel)])
    behind = np.concatenate([[0], np.cumsum(seen - gel)])
    right = before + behind[-1] - behind
    count = int(np.argmax(right))
    total, rest = int(seen.sum()), int(seen[count:].sum())
    if total == 0 or right[count] < AGREED * total or rest < LEAST_REST * total:
        return None
    return count or None
