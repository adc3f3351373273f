"""Division of vessels into elements: complete, straight, of limited length."""

from __future__ import annotations

import numpy as np
import pytest

from design.toolpath.embedded.elements import STRAIGHT_MM, elements_of
from tests.design.toolpath.shapes import cage, helix, polyline, polylines, random_tree, ring

NETWORKS = {
    "tree": random_tree(9, 8, 1, 0.1),
    "cage": cage(5, 2.0, 3.0),
    "helix": polyline(helix(2, 2.0, 1.0), 0.2),
    "ring": polylines([ring(2.0, 0.3)], 0.2),
}


def gap_to_line(place, line):
    """Distance of a place from a polyline."""
    a, way = line[:-1], np.diff(line, axis=0)
    share = np.clip(((place - a) * way).sum(axis=1) / (way**2).sum(axis=1), 0, 1)
    return np.linalg.norm(a + share[:, None] * way - place, axis=1).min()


@pytest.mark.parametrize("name", NETWORKS)
def test_every_point_of_a_vessel_lies_within_2_um_of_its_elements(name):
    net = NETWORKS[name]
    elements = elements_of(net, 0.15)
    for vessel in range(net.vessel_count):
        own = elements.end[elements.first[vessel] : elements.first[vessel + 1]]
        line = elements.point[np.append(own[:, 0], own[-1, 1])]
        assert max(gap_to_line(p, line) for p in net.polyline(vessel)[0]) <= STRAIGHT_MM + 1e-12
