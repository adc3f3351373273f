"""Separation of lumens and outer faces of a scanned surface."""

from __future__ import annotations

import numpy as np

from registration.measuring.gauging.near_lumen import split_summary
from registration.report.sections import surface_rows
from tests.registration.parts import planar_network


def test_lumens_and_outer_faces_have_their_own_deviations() -> None:
    wall = np.array([[8.0, 3.2, 1.75], [8.0, 5.0, 1.8]])
    face = np.array([[8.0, 4.0, 3.0], [0.0, 7.5, 0.2], [16.0, 7.5, 0.2]])
    rigid = np.array([-10.0, -10.0, 40.0, 40.0, 40.0])
    found = split_summary(np.concatenate([wall, face]), planar_network(), rigid, rigid / 2)
    assert found["lumens"]["points"] == 2
    assert found["lumens"]["rigid"]["mean_um"] == -10.0
    assert found["outer_faces"]["scaled"]["rms_um"] == 20.0
    mean = next(row for row in surface_rows({"by_surface": found}) if row[0].startswith("Mean"))
    assert mean[1:] == ("−10.0", "−5.0", "40.0", "20.0")
