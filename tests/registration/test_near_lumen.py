"""Separation of lumens and outer faces of a scanned surface."""

from __future__ import annotations

import numpy as np

from registration.measuring.gauging.deviation import split_summary
from registration.report.key_figures import key_figures
from registration.report.page import all_figures
from registration.report.sections import fit_rows, surface_rows
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


def test_a_scan_of_lumens_alone_has_no_outer_faces() -> None:
    wall = np.array([[8.0, 3.2, 1.75]])
    found = split_summary(wall, planar_network(), np.ones(1), np.ones(1))
    assert found["outer_faces"] is None
    assert len(surface_rows({"by_surface": found})) > 0


def test_a_surface_without_any_stated_deviation_has_neither() -> None:
    none = np.zeros(0)
    found = split_summary(np.zeros((0, 3)), planar_network(), none, none)
    assert found == {"lumens": None, "outer_faces": None}


def test_histogram_and_shares_are_shown_of_each_and_not_of_the_mixture() -> None:
    wall = np.array([[8.0, 3.2, 1.75], [8.0, 5.0, 1.8]])
    face = np.array([[8.0, 4.0, 3.0], [0.0, 7.5, 0.2]])
    rigid = np.array([-10.0, -12.0, 110.0, 110.0])
    found = split_summary(np.concatenate([wall, face]), planar_network(), rigid, rigid / 2)
    lumens, faces = found["lumens"], found["outer_faces"]
    assert sum(lumens["histogram"]["counts_rigid"]) == sum(faces["histogram"]["counts"]) == 2
    at = lumens["within_curve"]["tolerance_um"].index(20.0)
    assert (lumens["within_curve"]["rigid"][at], faces["within_curve"]["rigid"][at]) == (1.0, 0.0)
    mixed = {"rms_um": 70.0, "within": {"100": 0.5}}
    numbers = {"rigid": mixed, "scaled": mixed, "by_surface": found}
    assert not any(row[0].startswith("Within") for row in fit_rows(numbers))
    assert any(row[0].startswith("Within") for row in fit_rows({"rigid": mixed, "scaled": mixed}))
    share = next(one for one in key_figures({"registration": numbers}) if "within" in one.label)
    assert (share.label, share.value) == ("Lumens within ± 100 µm", "100")
    names = [name for name in all_figures({"registration": numbers}, None) if "histogram/" in name]
    assert len(names) == 4
    assert sum("of the lumens" in name for name in names) == 2
