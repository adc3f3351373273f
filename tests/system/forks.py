"""A network of one fork, small enough for whole runs."""

import numpy as np

from design.network import VesselKind, VesselNetwork

FORK = VesselNetwork.from_segments(
    np.array([[0.5, 3, 2], [3.0, 3, 2], [5.5, 1.2, 2.4], [5.5, 4.6, 1.4]]),
    np.array([[0, 1], [1, 2], [1, 3]]),
    np.array([0.4, 0.3, 0.3]),
    np.full(3, VesselKind.ARTERY, dtype=np.int64),
    np.zeros(3, dtype=np.int64),
)
