"""Shipped example network: four parallel channels, its planar block and pose dimples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from design.network import VesselKind, VesselNetwork


@dataclass(frozen=True)
class Dimple:
    """A hemispherical dimple in a part's top face, which marks its pose.

    Attributes
    ----------
    centre_mm : (float, float, float)
        On the face.
    diameter_mm : float
    """

    centre_mm: tuple[float, float, float]
    diameter_mm: float


PLANAR_BLOCK_MM: Final = (16.0, 8.0, 3.0)
"""Block around `planar_four_vessel`, from the origin."""

PLANAR_DIMPLES: Final = (
    Dimple((1.5, 1.0, 3.0), 0.6),
    Dimple((14.5, 1.0, 3.0), 0.6),
    Dimple((1.5, 7.0, 3.0), 0.6),
)
"""Dimples in the block's top face: two mark the x axis, the third the y axis."""

_INLET_Y = 4.1
_CHANNELS: Final = ((1.4, 0.4), (3.2, 0.5), (5.0, 0.6), (6.8, 0.8))
_HEADER_X: Final = (3.0, 13.0)
_WIDE = 1.0
_Z = 1.5


def planar_four_vessel() -> VesselNetwork:
    """Inlet, header, four channels of different width, header, outlet; all at z = 1.5 mm.

    Vessels, split at junctions: 0 the inlet; 1 to 4 the first header's pieces, outwards from the
    inlet; 5 to 8 the channels, by rising y; 9 to 12 the second header's pieces, in towards the
    outlet; 13 the outlet. Flow runs from first to last node of each.
    """
    heights = [y for y, _ in _CHANNELS]
    near, far = _HEADER_X
    nodes = [(0.0, _INLET_Y), (near, _INLET_Y), (far, _INLET_Y), (PLANAR_BLOCK_MM[0], _INLET_Y)]
    nodes += [(near, y) for y in heights] + [(far, y) for y in heights]
    # From the inlet's junction outwards: the inner channels first, the outer ones behind them.
    header = [(1, 5), (5, 4), (1, 6), (6, 7)]
    back = [(9, 2), (8, 9), (10, 2), (11, 10)]
    channels = [(4 + k, 8 + k) for k in range(4)]
    ends = [(0, 1), *header, *channels, *back, (2, 3)]
    diameter = [_WIDE] * 5 + [d for _, d in _CHANNELS] + [_WIDE] * 5
    return VesselNetwork.from_segments(
        np.column_stack([np.array(nodes), np.full(len(nodes), _Z)]),
        np.array(ends),
        0.5 * np.array(diameter),
        np.full(len(ends), int(VesselKind.CHANNEL)),
        np.zeros(len(ends), dtype=np.int64),
    )
