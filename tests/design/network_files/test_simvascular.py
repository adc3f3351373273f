"""SimVascular path files, read as SimVascular's own reader does."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from design.errors import NetworkError
from design.network import VesselNetwork
from design.network_files.simvascular import vessel_runs, write_simvascular_paths
from tests.design.networks import networks
from tests.slower import examples


def fork() -> VesselNetwork:
    nodes = np.array([[0.0, 0, 0], [0, 0, 10], [0, 5, 15], [0, -2, 14]])
    ends = np.array([[0, 1], [1, 2], [1, 3]])
    return VesselNetwork.from_segments(
        nodes, ends, np.array([1.0, 0.5, 0.8]), np.zeros(3), np.zeros(3)
    )


def vectors(parent: ET.Element, tag: str) -> np.ndarray:
    return np.array([[float(e.attrib[c]) for c in "xyz"] for e in parent.iter(tag)])


def read(path: Path) -> dict[str, np.ndarray]:
    root = ET.parse(path).getroot()
    assert root.tag == "path"
    assert {"id", "method", "calculation_number", "spacing"} <= root.attrib.keys()
    (element,) = root.findall("timestep/path_element")
    rows = element.findall("path_points/path_point")
    assert [int(row.attrib["id"]) for row in rows] == list(range(len(rows)))
    assert int(element.attrib["calculation_number"]) == len(rows)
    controls = element.find("control_points")
    assert controls is not None
    return {
        "control": vectors(controls, "point"),
        **{tag: vectors(element, tag) for tag in ("pos", "tangent", "rotation")},
    }


def test_the_widest_branch_goes_on_and_the_other_begins_at_the_fork(tmp_path: Path) -> None:
    files = write_simvascular_paths(tmp_path / "Paths", fork())
    assert [file.name for file in files] == ["path_0001.pth", "path_0002.pth"]
    trunk, twig = (read(file)["control"] for file in files)
    np.testing.assert_allclose(trunk, 0.1 * fork().nodes[[0, 1, 3]])
    np.testing.assert_allclose(twig, 0.1 * fork().nodes[[1, 2]])


def test_points_lie_on_the_path_with_unit_tangents_and_normals(tmp_path: Path) -> None:
    for file in write_simvascular_paths(tmp_path, fork(), spacing_mm=0.3):
        found = read(file)
        step = np.diff(found["pos"], axis=0)
        length = np.linalg.norm(step, axis=1)
        assert length.max() <= 0.03 + 1e-12
        np.testing.assert_allclose(step / length[:, None], found["tangent"][:-1], atol=1e-9)
        for name in ("tangent", "rotation"):
            np.testing.assert_allclose(np.linalg.norm(found[name], axis=1), 1.0)
        dot = np.einsum("ij,ij->i", found["tangent"], found["rotation"])
        np.testing.assert_allclose(dot, 0.0, atol=1e-12)
        total = np.linalg.norm(np.diff(found["control"], axis=0), axis=1).sum()
        assert length.sum() == pytest.approx(total)


@settings(deadline=None, max_examples=examples(40))
@given(network=networks)
def test_every_vessel_is_in_one_run_that_follows_the_flow(network: VesselNetwork) -> None:
    runs = vessel_runs(network)
    assert sorted(i for run in runs for i in run) == list(range(network.vessel_count))
    for run in runs:
        for one, two in pairwise(run):
            assert network.vessel_nodes[one, 1] == network.vessel_nodes[two, 0]


def test_a_spacing_of_nought_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NetworkError, match="spacing_mm"):
        write_simvascular_paths(tmp_path, fork(), spacing_mm=0.0)
    assert list(tmp_path.iterdir()) == []


def test_the_normal_is_that_of_a_path_written_by_simvascular() -> None:
    from design.network_files.simvascular import _normals

    tangent = np.array(
        [
            [0.459604696925632, 0.399318918662815, -0.793289306471389],
            [0.6, 0.8, 0.0],
            [1.0, 0.0, 0.0],
        ]
    )
    wanted = [[0, 0.89321949067228, 0.449620886395586], [0.8, -0.6, 0.0], [0, 0, 1]]
    np.testing.assert_allclose(_normals(tangent), wanted, atol=1e-9)
