"""Networks as JSON, npz and SWC: round trips, and refusal of what a format can't hold."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from design.errors import NetworkError
from design.network import VesselKind, VesselNetwork
from design.network_files.json_format import read_network_json, write_network_json
from design.network_files.npz import read_network_npz, write_network_npz
from design.network_files.swc import KIND_TYPE, read_network_swc, write_network_swc
from design.vasculature import planar_four_vessel
from tests.design.networks import networks, random_network, trees
from tests.slower import examples

Reader = Callable[[Path], VesselNetwork]
Writer = Callable[[Path, VesselNetwork], None]
EXACT = [
    pytest.param(write_network_json, read_network_json, "n.json", id="json"),
    pytest.param(write_network_npz, read_network_npz, "n.npz", id="npz"),
]


def assert_same(one: VesselNetwork, two: VesselNetwork) -> None:
    for field in fields(VesselNetwork):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(two, field.name))
        assert getattr(one, field.name).dtype == getattr(two, field.name).dtype


def rows(network: VesselNetwork) -> np.ndarray:
    """Pieces with radii and kind, in an order of their own."""
    start, end, ra, rb, vessel = network.pieces()
    table = np.column_stack([start, end, ra, rb, network.kind[vessel]])
    return table[np.lexsort(table.round(6).T)]


@pytest.mark.parametrize(("write", "read", "name"), EXACT)
def test_any_network_reads_back_to_the_bit(write: Writer, read: Reader, name: str) -> None:
    @settings(deadline=None, max_examples=examples(40))
    @given(network=networks)
    def check(network: VesselNetwork) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            write(path, network)
            assert_same(read(path), network)
            before = path.read_bytes()
            write(path, read(path))
            assert path.read_bytes() == before

    check()


@settings(deadline=None, max_examples=examples(60))
@given(network=trees)
def test_trees_read_back_from_swc(network: VesselNetwork) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "n.swc"
        write_network_swc(path, network)
        found = read_network_swc(path)
    np.testing.assert_allclose(rows(found), rows(network), rtol=1e-12, atol=1e-12)
    for ends in ("inlets", "outlets"):
        there = found.nodes[getattr(found, ends)()]
        wanted = network.nodes[getattr(network, ends)()]
        np.testing.assert_allclose(there[np.lexsort(there.T)], wanted[np.lexsort(wanted.T)])
    assert len(np.unique(found.tree)) == len(np.unique(network.tree))


def test_swc_is_in_micrometres_with_parents_before_children(tmp_path: Path) -> None:
    network = VesselNetwork.from_segments(
        np.array([[0.0, 0, 0], [0, 0, 1.5], [0, 1, 2]]),
        np.array([[0, 1], [1, 2]]),
        np.array([0.2, 0.1]),
        np.full(2, VesselKind.LYMPH),
        np.zeros(2),
    )
    path = tmp_path / "n.swc"
    write_network_swc(path, network)
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    kind = KIND_TYPE[VesselKind.LYMPH]
    # Lymph flows to its root, the outlet.
    assert lines == [
        f"1 {kind} 0.0 1000.0 2000.0 100.0 -1",
        f"2 {kind} 0.0 0.0 1500.0 100.0 1",
        f"3 {kind} 0.0 0.0 1500.0 200.0 2",
        f"4 {kind} 0.0 0.0 0.0 200.0 3",
    ]


def test_swc_refuses_loops_and_rings(tmp_path: Path) -> None:
    with pytest.raises(NetworkError, match=r"trees only: node 2 is reached by 2 vessels"):
        two = VesselNetwork.from_segments(
            np.eye(3), np.array([[0, 1], [1, 2], [0, 2]]), np.ones(3), np.zeros(3), np.zeros(3)
        )
        write_network_swc(tmp_path / "n.swc", two)
    with pytest.raises(NetworkError, match="trees only"):
        write_network_swc(tmp_path / "n.swc", planar_four_vessel())
    ring = VesselNetwork.from_segments(
        np.eye(3), np.array([[0, 1], [1, 2], [2, 0]]), np.ones(3), np.zeros(3), np.zeros(3)
    )
    with pytest.raises(NetworkError, match="3 vessels flow in a ring"):
        write_network_swc(tmp_path / "n.swc", ring)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1 1 0 0 0 1 -1\n2 1 0 0 x 1 1\n", "line 2.*isn't number"),
        ("1 1 0 0 0 1 -1\n2 1 0 0 5\n", "line 2.*isn't number"),
        ("1 1 0 0 0 1 -1\n2 1 0 0 5 1 3\n", "line 2: parent 3 isn't"),
        ("1 1 0 0 0 1 -1\n1 1 0 0 5 1 1\n", "line 2: point 1 is there twice"),
        ("1 1 0 0 0 1 -1\n2 1 0 0 5 1 3\n3 1 0 0 6 1 2\n", "line 2: the point's parents form"),
        ("1 1 0 0 0 1 -1\n2 1 0 0 5 0 1\n", "line 2.*radius 0 mm isn't above 0"),
        ("1 1 0 0 0 1 -1\n2 1 0 0 nan 1 1\n", "line 2.*NaN"),
        ("1 1 0 0 0 1 -1\n2 1 0 0 0 1 1\n", "no two points are apart"),
        ("# nothing\n", "fewer than two points"),
    ],
)
def test_bad_swc_is_refused_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "bad.swc"
    path.write_text(text)
    with pytest.raises(NetworkError, match=says):
        read_network_swc(path)


def test_bad_json_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "n.json"
    write_network_json(path, random_network(1, 3))
    good = json.loads(path.read_text())
    assert good["unit"] == "mm"
    for says, change in [
        ("version", {"version": 2}),
        ("unit", {"unit": "cm"}),
        ("nodes or vessels", {"nodes": "none"}),
        ("no vessels", {"vessels": []}),
        ("kind of artery", {"vessels": [{**good["vessels"][0], "kind": "aorta"}]}),
        ("joins nodes", {"vessels": [{**good["vessels"][0], "nodes": [0, 9]}]}),
        ("two or more points", {"vessels": [{**good["vessels"][0], "points": [[0, 0, 0, 1]]}]}),
        ("radius 0 mm", {"vessels": [{**good["vessels"][0], "points": [[0, 0, 0, 0]] * 2}]}),
    ]:
        path.write_text(json.dumps({**good, **change}))
        with pytest.raises(NetworkError, match=says):
            read_network_json(path)
    path.write_text("{")
    with pytest.raises(NetworkError, match="not JSON"):
        read_network_json(path)


def test_bad_npz_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "n.npz"
    write_network_npz(path, random_network(1, 3))
    with np.load(path) as data:
        good = dict(data)
    for says, change in [
        ("format", {"format": np.array("other")}),
        ("radius is float32", {"radius": good["radius"].astype(np.float32)}),
        ("joins node 99", {"vessel_nodes": good["vessel_nodes"] * 0 + 99}),
        ("differ in length", {"kind": good["kind"][:1]}),
        ("wrong shape", {"vessel_nodes": np.zeros((3, 3), dtype=np.int64)}),
    ]:
        np.savez(path, **{**good, **change})
        with pytest.raises(NetworkError, match=says):
            read_network_npz(path)
    path.write_bytes(b"PK, but no archive")
    with pytest.raises(NetworkError, match=r"not a network in \.npz"):
        read_network_npz(path)
    with pytest.raises(NetworkError, match=r"ends in \.npz"):
        write_network_npz(tmp_path / "n.bin", random_network(1, 3))


def test_a_traced_swc_is_read_whatever_its_numbers_and_order(tmp_path: Path) -> None:
    path = tmp_path / "traced.swc"
    path.write_text(
        "# traced\n\n 7 3 0 0 2000 50 9 # tip\n9 3 0 0 1000 100 4\n4 1 0 0 0 100 -1\n"
        "8 3 0 500 1500 40 9\n"
    )
    found = read_network_swc(path, kind=VesselKind.CHANNEL)
    assert found.vessel_count == 3
    assert set(found.kind) == {VesselKind.CHANNEL}
    np.testing.assert_allclose(found.nodes[found.inlets()], [[0, 0, 0]])
    assert sorted(found.lengths().round(6)) == [round(0.5**0.5, 6), 1.0, 1.0]
