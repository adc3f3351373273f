"""A network of one fork, small enough for whole runs."""

import re

import numpy as np

from design.network import VesselKind, VesselNetwork

FORK = VesselNetwork.from_segments(
    np.array([[0.5, 3, 2], [3.0, 3, 2], [5.5, 1.2, 2.4], [5.5, 4.6, 1.4]]),
    np.array([[0, 1], [1, 2], [1, 3]]),
    np.array([0.4, 0.3, 0.3]),
    np.full(3, VesselKind.ARTERY, dtype=np.int64),
    np.zeros(3, dtype=np.int64),
)
_SECTIONS = {
    "tissue": "{shape: block, size_mm: [6, 6, 4]}",
    "vasculature": "{network: fork.csv, unit: mm}",
    "toolpath": "{method: fresh, needle: 22g, layer_um: 150, line_um: 400}",
    "scan": "{simulated: oct, voxel_um: [60, 60, 30]}",
}


def of_fork(starter: str) -> str:
    """Text of the starter's recipe for that network: its way is as long, its work a third."""
    for section, short in _SECTIONS.items():
        starter = re.sub(rf"(?m)^{section}:.*\n(?:  .*\n)+", f"{section}: {short}\n", starter)
    return starter
