"""`network.csv`: lossless round trip, and errors named with their line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.errors import NetworkError
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv, write_network_csv
from tests.slower import examples

HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"

# Nothing nearer to 0 than this: the square of a shorter way vanishes.
coordinate = st.floats(-1e3, 1e3, allow_nan=False).map(lambda x: x if abs(x) > 1e-9 else 0.0)
radius = st.floats(1e-3, 1e2, allow_nan=False)
FIELDS = ("nodes", "vessel_nodes", "kind", "tree", "offset", "points", "radius")


@st.composite
def networks(draw: st.DrawFn) -> VesselNetwork:
    """Any connected multigraph, loops and rings included, with bent and tapered vessels."""
    vessels = draw(st.integers(1, 6))
    ends = [(0, 1)]
    for _ in range(vessels - 1):
        known = 1 + max(max(pair) for pair in ends)
        ends.append((draw(st.integers(0, known - 1)), draw(st.integers(0, known))))
    node_count = 1 + max(max(pair) for pair in ends)
    vectors = st.tuples(coordinate, coordinate, coordinate)
    nodes = np.array(draw(st.lists(vectors, min_size=node_count, max_size=node_count, unique=True)))
    points, offset = [], [0]
    for first, last in ends:
        least = 1 if first == last else 0
        inner = draw(st.lists(vectors, min_size=2 * least, max_size=4, unique=True))
        points += [nodes[first], *inner, nodes[last]]
        offset.append(len(points))
    count = len(points)
    return VesselNetwork(
        nodes=nodes,
        vessel_nodes=np.array(ends),
        kind=np.array(draw(st.lists(st.integers(0, 4), min_size=vessels, max_size=vessels))),
        tree=np.array(draw(st.lists(st.integers(0, 9), min_size=vessels, max_size=vessels))),
        offset=np.array(offset),
        points=np.array(points),
        radius=np.array(draw(st.lists(radius, min_size=count, max_size=count))),
    )


@settings(max_examples=examples(60), deadline=None)
@given(network=networks())
def test_a_written_network_reads_back_to_the_bit(network, tmp_path_factory):
    path = tmp_path_factory.mktemp("csv") / "network.csv"
    write_network_csv(path, network)
    again = read_network_csv(path, "mm")
    for name in FIELDS:
        before, after = getattr(network, name), getattr(again, name)
        assert after.dtype == before.dtype
        assert np.array_equal(after, before), name


@settings(max_examples=examples(40), deadline=None)
@given(network=networks(), seed=st.integers(0, 2**32 - 1))
def test_the_order_of_rows_changes_no_vessel(network, seed, tmp_path_factory):
    path = tmp_path_factory.mktemp("csv") / "network.csv"
    write_network_csv(path, network)
    header, *rows = path.read_text().splitlines()
    ring = network.vessel_nodes[:, 0] == network.vessel_nodes[:, 1]
    if ring.any():
        return  # where a ring begins is told by the order of its rows alone
    mixed = np.random.default_rng(seed).permutation(rows)
    path.write_text("\n".join([header, *mixed]) + "\n")
    again = read_network_csv(path, "mm")
    order = np.array(list(dict.fromkeys(int(row.split(",")[0]) for row in mixed)))
    assert np.array_equal(again.vessel_nodes, network.vessel_nodes[order])
    assert np.array_equal(again.nodes, network.nodes)
    for place, vessel in enumerate(order):
        for before, after in zip(network.polyline(vessel), again.polyline(place), strict=True):
            assert np.array_equal(before, after)


def _file(tmp_path: Path, *rows: str, header: str = HEADER) -> Path:
    path = tmp_path / "network.csv"
    path.write_text(header + "".join(row + "\n" for row in rows))
    return path


def test_a_vessel_is_cut_where_another_joins_it(tmp_path: Path) -> None:
    network = read_network_csv(
        _file(
            tmp_path,
            "7,10,11,0,0,0,1,0,0,0.5,0.5,vein,0",
            "7,11,12,1,0,0,2,0,0,0.5,0.5,vein,0",
            "7,12,13,2,0,0,3,0,0,0.5,0.5,vein,0",
            "9,12,20,2,0,0,2,5,0,0.2,0.2,vein,0",
        ),
        "mm",
    )
    assert network.vessel_nodes.tolist() == [[0, 1], [1, 2], [1, 3]]
    assert network.offset.tolist() == [0, 3, 5, 7]


def test_a_vessel_is_cut_where_its_radius_jumps(tmp_path: Path) -> None:
    network = read_network_csv(
        _file(
            tmp_path,
            "0,0,1,0,0,0,1,0,0,0.5,0.5,vein,0",
            "0,1,2,1,0,0,2,0,0,0.3,0.3,vein,0",
        ),
        "mm",
    )
    assert network.vessel_count == 2
    assert network.radius.tolist() == [0.5, 0.5, 0.3, 0.3]


GOOD = "0,0,1,0,0,0,1,0,0,0.5,0.5,vein,0"


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["0,0,1,0,0,nan,1,0,0,0.5,0.5,vein,0"], r"line 2.*NaN"),
        ([GOOD, "1,1,2,1,0,0,inf,0,0,0.5,0.5,vein,0"], r"line 3.*infinite"),
        (["0,0,1,0,0,0,1,0,0,0.5,0,vein,0"], r"line 2.*radius 0 mm"),
        (["0,0,1,0,0,0,1,0,0,wide,0.5,vein,0"], r"line 2: radius0_mm is 'wide'.*a number"),
        (["0,0,1,0,0,0,1,0,0,0.5,0.5,arterie,0"], r"line 2: kind is 'arterie'.*artery, vein"),
        (["0,0,1.5,0,0,0,1,0,0,0.5,0.5,vein,0"], r"line 2: node1 is '1.5'.*whole"),
        (["0,0,1,0,0,0,1,0"], r"line 2: 8 fields.*13"),
        (["0,3,3,0,0,0,1,0,0,0.5,0.5,vein,0"], r"line 2.*node 3 to itself"),
        (["0,0,1,1,0,0,1,0,0,0.5,0.5,vein,0"], r"line 2.*zero length"),
        ([GOOD, "0,1,2,1.1,0,0,2,0,0,0.5,0.5,vein,0"], r"line 3.*node 1 lies 0.1 mm.*line 2"),
        ([GOOD, "0,2,3,1,0,0,2,0,0,0.5,0.5,vein,0"], r"line 3.*broken chain.*line 2"),
        ([GOOD, "0,2,1,2,0,0,1,0,0,0.5,0.5,vein,0"], r"line 3.*line 2 both enter node 1"),
        ([GOOD, "0,1,2,1,0,0,2,0,0,0.5,0.5,artery,0"], r"line 3.*kind differs"),
        ([GOOD, "0,1,2,1,0,0,2,0,0,0.5,0.5,vein,1"], r"line 3.*tree differs"),
        ([], r"no pieces"),
    ],
)
def test_a_bad_row_is_refused_with_file_and_line(tmp_path, rows, message):
    with pytest.raises(NetworkError, match=message) as caught:
        read_network_csv(_file(tmp_path, *rows), "mm")
    assert "network.csv" in str(caught.value)


def test_a_missing_column_is_named(tmp_path: Path) -> None:
    header = HEADER.replace("z1,", "").replace(",tree", "")
    with pytest.raises(NetworkError, match=r"line 1: column z1, tree missing"):
        read_network_csv(_file(tmp_path, GOOD, header=header), "mm")


def test_a_polyline_off_its_nodes_is_not_written(tmp_path: Path) -> None:
    network = VesselNetwork.from_segments(
        np.eye(3), np.array([[0, 1]]), np.array([0.1]), np.array([0]), np.array([0])
    )
    network.points[1] += 0.5
    with pytest.raises(NetworkError, match=r"vessel 0.*from its node"):
        write_network_csv(tmp_path / "network.csv", network)
    assert list(tmp_path.iterdir()) == []
