"""Network files: round trips, units never guessed, errors named with their line."""

import json
import tempfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design import VesselKind, VesselNetwork, planar_four_vessel, read_network, write_network
from design.errors import NetworkError
from design.network_files.by_suffix import read_with_notes
from design.network_files.csv_format import read_network_csv, write_network_csv
from design.network_files.json_format import (
    read_network_json,
    read_network_npz,
    write_network_json,
    write_network_npz,
)
from design.network_files.swc import KIND_TYPE, read_network_swc, write_network_swc
from tests.design.networks import network, networks, random_network, trees
from tests.slower import examples

# JSON, npz and SWC.


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
    nodes = [[0, 0, 0], [0, 0, 1.5], [0, 1, 2]]
    path = tmp_path / "n.swc"
    write_network_swc(path, network(nodes, [(0, 1), (1, 2)], [0.2, 0.1], VesselKind.LYMPH))
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
        two = network(np.eye(3), [(0, 1), (1, 2), (0, 2)], 1.0)
        write_network_swc(tmp_path / "n.swc", two)
    with pytest.raises(NetworkError, match="trees only"):
        write_network_swc(tmp_path / "n.swc", planar_four_vessel())
    ring = network(np.eye(3), [(0, 1), (1, 2), (2, 0)], 1.0)
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
    for key, says in (
        ("simulation_parameters", "is a case of svZeroDSolver"),
        ("calibration_parameters", "is an input of svZeroDCalibrator, not a network"),
    ):
        path.write_text(json.dumps({"vessels": [], key: {}}))
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


# `network.csv`.


HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"

# Nothing nearer to 0 than this: the square of a shorter way vanishes.
coordinate = st.floats(-1e3, 1e3, allow_nan=False).map(lambda x: x if abs(x) > 1e-9 else 0.0)
radius = st.floats(1e-3, 1e2, allow_nan=False)
FIELDS = ("nodes", "vessel_nodes", "kind", "tree", "offset", "points", "radius")


@st.composite
def connected_networks(draw: st.DrawFn) -> VesselNetwork:
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
@given(net=connected_networks())
def test_a_written_network_reads_back_to_the_bit(net, tmp_path_factory):
    path = tmp_path_factory.mktemp("csv") / "network.csv"
    write_network_csv(path, net)
    again = read_network_csv(path, "mm")
    for name in FIELDS:
        before, after = getattr(net, name), getattr(again, name)
        assert after.dtype == before.dtype
        assert np.array_equal(after, before), name


@settings(max_examples=examples(40), deadline=None)
@given(net=connected_networks(), seed=st.integers(0, 2**32 - 1))
def test_the_order_of_rows_changes_no_vessel(net, seed, tmp_path_factory):
    path = tmp_path_factory.mktemp("csv") / "network.csv"
    write_network_csv(path, net)
    header, *rows = path.read_text().splitlines()
    ring = net.vessel_nodes[:, 0] == net.vessel_nodes[:, 1]
    if ring.any():
        return  # where a ring begins is told by the order of its rows alone
    mixed = np.random.default_rng(seed).permutation(rows)
    path.write_text("\n".join([header, *mixed]) + "\n")
    again = read_network_csv(path, "mm")
    order = np.array(list(dict.fromkeys(int(row.split(",")[0]) for row in mixed)))
    assert np.array_equal(again.vessel_nodes, net.vessel_nodes[order])
    assert np.array_equal(again.nodes, net.nodes)
    for place, vessel in enumerate(order):
        for before, after in zip(net.polyline(vessel), again.polyline(place), strict=True):
            assert np.array_equal(before, after)


def _file(tmp_path: Path, *rows: str, header: str = HEADER) -> Path:
    path = tmp_path / "network.csv"
    path.write_text(header + "".join(row + "\n" for row in rows))
    return path


@pytest.mark.parametrize(
    ("rows", "nodes", "offset"),
    [
        (
            [
                "7,10,11,0,0,0,1,0,0,0.5,0.5,vein,0",
                "7,11,12,1,0,0,2,0,0,0.5,0.5,vein,0",
                "7,12,13,2,0,0,3,0,0,0.5,0.5,vein,0",
                "9,12,20,2,0,0,2,5,0,0.2,0.2,vein,0",
            ],
            [[0, 1], [1, 2], [1, 3]],
            [0, 3, 5, 7],
        ),
        (
            ["0,0,1,0,0,0,1,0,0,0.5,0.5,vein,0", "0,1,2,1,0,0,2,0,0,0.3,0.3,vein,0"],
            [[0, 1], [1, 2]],
            [0, 2, 4],
        ),
    ],
)
def test_a_vessel_is_cut_where_another_joins_it_or_its_radius_jumps(tmp_path, rows, nodes, offset):
    network = read_network_csv(_file(tmp_path, *rows), "mm")
    assert network.vessel_nodes.tolist() == nodes
    assert network.offset.tolist() == offset
    assert set(network.radius.tolist()) == {float(row.split(",")[9]) for row in rows}


GOOD = "0,0,1,0,0,0,1,0,0,0.5,0.5,vein,0"


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["0,0,1,0,0,nan,1,0,0,0.5,0.5,vein,0"], r"line 2.*NaN"),
        (["0,0,1,0,0,8e300,1,0,0,0.5,0.5,vein,0"], r"line 2.*beyond 1e\+06 mm"),
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


def test_a_missing_column_is_named_and_a_polyline_off_its_nodes_not_written(tmp_path: Path) -> None:
    header = HEADER.replace("z1,", "").replace(",tree", "")
    with pytest.raises(NetworkError, match=r"line 1: column z1, tree missing"):
        read_network_csv(_file(tmp_path, GOOD, header=header), "mm")
    off = network(np.eye(3), [(0, 1)], 0.1)
    off.points[1] += 0.5
    with pytest.raises(NetworkError, match=r"vessel 0.*from its node"):
        write_network_csv(tmp_path / "off.csv", off)
    assert not (tmp_path / "off.csv").exists()


# Format chosen by suffix; units.


@pytest.mark.parametrize("suffix", [".csv", ".json", ".npz"])
def test_network_reads_back_as_it_was_written(tmp_path: Path, suffix: str):
    path, network = tmp_path / f"network{suffix}", planar_four_vessel()
    write_network(path, network)
    again = read_network(path, "mm")
    np.testing.assert_array_equal(again.vessel_nodes, network.vessel_nodes)
    np.testing.assert_allclose(again.points, network.points)
    np.testing.assert_allclose(again.radius, network.radius)


@pytest.mark.parametrize(
    ("name", "unit", "message"),
    [
        ("a.csv", None, "doesn't say the unit.*give unit"),
        ("a.json", "um", "is in mm.*leave unit out"),
        ("a.docx", None, r"\.docx can't be read.*\.csv"),
        ("a", None, "no suffix can't be read"),
    ],
)
def test_what_cannot_be_read_is_refused(name, unit, message):
    with pytest.raises(NetworkError, match=message):
        read_network(Path(name), unit)


SWC = "1 2 0 0 0 0.5 -1\n2 2 0 0 5 0.5 1\n3 2 3 0 8 0.3 2\n"


@pytest.mark.parametrize(
    ("comments", "unit", "mm"),
    [
        ("", "mm", 1.0),
        ("", "um", 1e-3),
        ("# units: mm\n", None, 1.0),
        ("# unit = microns\n", "mm", 1.0),
        ("# unit: [mm]\n", None, 1.0),
        ("# units (um)\n", "mm", 1.0),
        ("# units: inches\n", None, 25.4),
        ("# SCALE 1000 1000 1000\n", None, 1.0),
        ("# SCALE: 2, 2, 2\n", "mm", 2.0),
    ],
)
def test_the_unit_of_swc_may_be_said(tmp_path: Path, comments: str, unit, mm: float):
    (tmp_path / "a.swc").write_text(comments + SWC)
    network = read_network(tmp_path / "a.swc", unit)
    assert network.points[:, 2].max() == pytest.approx(8.0 * mm)
    assert network.radius.max() == pytest.approx(0.5 * mm)


def test_scale_of_each_axis_keeps_the_volume(tmp_path: Path):
    (tmp_path / "a.swc").write_text("# SCALE 1000 1000 8000\n" + SWC)
    network, notes = read_with_notes(tmp_path / "a.swc")
    assert network.points.max(axis=0) == pytest.approx([3.0, 0.0, 64.0])
    assert network.radius.max() == pytest.approx(1.0)
    assert "1000, 1000 and 8000, radii by 2000" in notes[0]


@pytest.mark.parametrize(
    ("comments", "message"),
    [
        ("# unit: nm", "line 1: unit 'nm' isn't one of um, mm"),
        ("# unit pixel", "line 1: unit 'pixel'"),
        ("# unit: 10 um", "line 1: unit '10 um'"),
        ("# unit: mm\n# unit: um", "line 2: unit um here, mm in a line before"),
    ],
)
def test_a_unit_of_swc_that_cant_be_taken_is_refused(tmp_path, comments, message):
    (tmp_path / "a.swc").write_text(comments + "\n1 2 0 0 0 1 -1\n2 2 9 0 0 1 1\n")
    with pytest.raises(NetworkError, match=message):
        read_network(tmp_path / "a.swc")


def test_swc_of_sizes_that_nothing_prints_is_asked_about(tmp_path: Path):
    path = tmp_path / "a.swc"
    path.write_text(SWC)
    with pytest.raises(NetworkError, match=r"0.008 mm long.*radius 0.0005 mm.*µm.*--unit"):
        read_network(path)
    (note,) = read_with_notes(path, "um").notes
    assert "widest radius 0.0005 mm" in note
    (note,) = read_with_notes(path, "m").notes
    assert "8e+03 mm long" in note
    path.write_text("# SCALE 1 0 1\n" + SWC)
    with pytest.raises(NetworkError, match=r"line 1: .*three numbers above 0"):
        read_network(path)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("before", ["", "# by hand\n", "sep={}\n", "\n"])
def test_a_csv_tells_its_separator_by_its_header(tmp_path, separator, before):
    text = "X,Y,Z,Radius,Parent\n0,0,0,5,-1\n# a comment\n0,0,9,5,0\n".replace(",", separator)
    (tmp_path / "a.csv").write_text(before.format(separator) + text)
    assert read_network(tmp_path / "a.csv", "mm").lengths() == pytest.approx([9.0])
    header = "VESSEL,NODE0,NODE1,X0,Y0,Z0,X1,Y1,Z1,RADIUS0_MM,RADIUS1_MM,KIND,TREE"
    text = f"{header}\n0,0,1,0,0,0,0,0,9,1,1,artery,0\n".replace(",", separator)
    (tmp_path / "a.csv").write_text(before.format(separator) + text)
    assert read_network(tmp_path / "a.csv", "mm").lengths() == pytest.approx([9.0])


def test_a_csv_of_points_names_parents_by_row_or_id(tmp_path: Path):
    path = tmp_path / "points.csv"
    path.write_text("x,y,z,radius,parent\n0,0,0,5,-1\n0,0,9,5,0\n3,0,12,4,1\n-3,0,12,4,1\n")
    network = read_network(path, "cm")
    assert sorted(network.lengths()) == pytest.approx([30 * 2**0.5, 30 * 2**0.5, 90.0])
    assert network.radius.max() == 50.0
    assert (len(network.inlets()), len(network.outlets())) == (1, 2)
    path.write_text("Parent, id, radius, z, y, x, kind\n7,3,1,9,0,0,vein\n,7,1,0,0,0,vein\n")
    network = read_network(path, "mm")
    assert network.lengths() == pytest.approx([9.0])
    assert network.kind.tolist() == [VesselKind.VEIN]
