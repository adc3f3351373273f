"""`network.vtp`, decoded here by the rules of VTK's XML format, and SimVascular's path files."""

import base64
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise, permutations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.errors import NetworkError
from design.network import VesselKind, VesselNetwork
from design.network_files.by_suffix import read_network
from design.network_files.vtp import (
    _normals,
    vessel_runs,
    write_network_vtp,
    write_simvascular_paths,
)
from tests.design.networks import network, networks, polylines, random_trees
from tests.slower import examples

DTYPES = {"Float64": "<f8", "Float32": "<f4", "Int64": "<i8", "Int32": "<i4"}


def _network() -> VesselNetwork:
    lines = [[(0, 0, 0), (1, 1, 0), (3, 0, 0)], [(3, 0, 0), (3, 4, 0.1)]]
    made = polylines(lines, [0.5, 0.4, 0.3, 0.3, 0.1], [0, 1])
    return replace(made, tree=np.array([5, 6]))


def _arrays(path: Path) -> dict[str, np.ndarray]:
    root = ET.parse(path).getroot()
    assert root.attrib["type"] == "PolyData"
    assert root.attrib["header_type"] == "UInt64"
    arrays = {}
    for element in root.iter("DataArray"):
        data = base64.b64decode(element.text or "")
        (size,) = np.frombuffer(data[:8], "<u8")
        assert size == len(data) - 8
        values = np.frombuffer(data[8:], DTYPES[element.attrib["type"]])
        width = int(element.attrib["NumberOfComponents"])
        arrays[element.attrib["Name"]] = values.reshape(-1, width) if width > 1 else values
    return arrays


def test_points_radii_and_cells_are_those_of_the_network(tmp_path: Path) -> None:
    network = _network()
    path = tmp_path / "network.vtp"
    write_network_vtp(path, network, {"flow_ul_s": np.array([1.5, -2.0])})
    arrays = _arrays(path)
    assert np.array_equal(arrays["Points"], network.points)
    assert np.array_equal(arrays["radius_mm"], network.radius)
    assert arrays["connectivity"].tolist() == [0, 1, 2, 3, 4]
    assert arrays["offsets"].tolist() == [3, 5]
    assert arrays["kind"].tolist() == [0, 1]
    assert arrays["tree"].tolist() == [5, 6]
    assert arrays["vessel"].tolist() == [0, 1]
    assert arrays["flow_ul_s"].tolist() == [1.5, -2.0]


# Reading VTP network files, ours and other programs'.

POINTS = "0 0 0  10 0 0  20 0 0  10 0 0  10 8 0"
"""A straight line of three points, and one that leaves its middle."""


def document(
    points: str = POINTS,
    radius: str = "2 2 2 1 1",
    connectivity: str = "0 1 2 3 4",
    offsets: str = "3 5",
    name: str = "radius",
    attributes: str = "",
    form: str = "ascii",
    cells: str = "",
) -> str:
    def array(title: str, kind: str, text: str, width: int = 1) -> str:
        return (
            f'<DataArray type="{kind}" Name="{title}" NumberOfComponents="{width}" '
            f'format="{form}">{text}</DataArray>'
        )

    return (
        f'<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian" {attributes}>'
        f'<PolyData><Piece NumberOfPoints="5" NumberOfLines="2">'
        f"<PointData>{array(name, 'Float64', radius)}</PointData><CellData>{cells}</CellData>"
        f"<Points>{array('Points', 'Float64', points, 3)}</Points>"
        f"<Lines>{array('connectivity', 'Int64', connectivity)}"
        f"{array('offsets', 'Int64', offsets)}</Lines></Piece></PolyData></VTKFile>"
    )


def written(folder: Path, text: str) -> Path:
    path = folder / "network.vtp"
    path.write_text(text)
    return path


def same_vessels(found: VesselNetwork, network: VesselNetwork) -> None:
    for name in ("points", "radius", "offset", "kind", "tree"):
        assert np.array_equal(getattr(found, name), getattr(network, name)), name
    ends = found.nodes[found.vessel_nodes]
    assert np.array_equal(ends, network.nodes[network.vessel_nodes])


@settings(max_examples=examples(25), deadline=None)
@given(st.integers(0, 1000), st.integers(1, 12), st.integers(1, 3))
def test_ours_come_back_to_the_bit(tmp_path_factory, seed, vessels, roots):
    network = random_trees(seed, vessels, min(roots, vessels))
    path = tmp_path_factory.mktemp("vtp") / "network.vtp"
    write_network_vtp(path, network, {"flow_ul_s": np.ones(network.vessel_count)})
    same_vessels(read_network(path, "mm"), network)


def test_lines_that_join_in_the_middle_are_cut_there(tmp_path: Path) -> None:
    network = read_network(written(tmp_path, document()), "cm")
    assert network.vessel_count == 3
    assert network.degree().tolist().count(3) == 1
    assert network.lengths() == pytest.approx([100.0, 100.0, 80.0])
    # A radius that isn't said to be in mm is in the file's unit.
    assert network.radius.tolist() == [20, 20, 20, 20, 10, 10]
    assert (network.kind == VesselKind.ARTERY).all()


@pytest.mark.parametrize("order", list(permutations(range(3))))
@pytest.mark.parametrize("step", [0.5, 1.0, 2.0])
def test_lines_of_shared_points_and_others_are_one_trunk(tmp_path, order, step):
    """One line traces the trunk by its own points, two by the same points, in any order."""
    trunk = [(x, 0.0, 0.0) for x in np.arange(0.0, 10.1, step)]
    lines = [
        [(0, 0.1, 0), (10, 0.1, 0), (16, 6, 0)],
        [*trunk, (16, -6, 0)],
        [*trunk, (16, 0, 6)],
    ]
    points = np.array([point for k in order for point in lines[k]], dtype=float)
    text = document(
        " ".join(map(str, points.ravel())),
        "1 " * len(points),
        " ".join(map(str, range(len(points)))),
        " ".join(map(str, np.cumsum([len(lines[k]) for k in order]))),
    )
    network = read_network(written(tmp_path, text), "mm")
    assert (network.vessel_count, len(network.inlets()), len(network.outlets())) == (4, 1, 3)
    # Of 10 mm and thrice √72 mm.
    assert network.lengths().sum() == pytest.approx(10 + 3 * 72**0.5, rel=0.02)


def packed(values: np.ndarray, head: str) -> str:
    data = values.tobytes()
    return base64.b64encode(np.array([len(data)], head).tobytes() + data).decode()


def deflated(values: np.ndarray, head: str, block: int = 40) -> str:
    data = values.tobytes()
    parts = [data[i : i + block] for i in range(0, len(data), block)]
    squeezed = [zlib.compress(part) for part in parts]
    rest = len(data) % block
    start = np.array([len(parts), block, rest, *map(len, squeezed)], head).tobytes()
    return base64.b64encode(start).decode() + base64.b64encode(b"".join(squeezed)).decode()


@pytest.mark.parametrize("header", ["UInt32", "UInt64"])
@pytest.mark.parametrize("compressed", [False, True])
def test_binary_as_paraview_writes_it(tmp_path: Path, header: str, compressed: bool) -> None:
    head = {"UInt32": "<u4", "UInt64": "<u8"}[header]
    pack = deflated if compressed else packed
    attributes = f'header_type="{header}"'
    attributes += ' compressor="vtkZLibDataCompressor"' if compressed else ""
    text = document(
        points=pack(np.array(POINTS.split(), dtype=float), head),
        radius=pack(np.array([2.0, 2, 2, 1, 1]), head),
        connectivity=pack(np.arange(5), head),
        offsets=pack(np.array([3, 5]), head),
        attributes=attributes,
        form="binary",
    )
    found = read_network(written(tmp_path, text), "mm")
    plain = tmp_path / "plain"
    plain.mkdir()
    same_vessels(found, read_network(written(plain, document()), "mm"))


@pytest.mark.parametrize("encoding", ["raw", "base64"])
@pytest.mark.parametrize("squeeze", [packed, deflated])
def test_appended_data_are_read(tmp_path: Path, encoding: str, squeeze: Callable) -> None:
    """As VTK's writer does by default, and with it VMTK and SimVascular."""
    numbers = [
        np.array([2.0, 2, 2, 1, 1]),
        np.array(POINTS.split(), "f8"),
        np.arange(5),
        np.array([3, 5]),
    ]
    body, text = b"", document("", "", "", "", form="appended")
    for each in numbers:
        text = text.replace('format="appended"', f'format="at" offset="{len(body)}"', 1)
        block = squeeze(each, "<u4").encode()
        if encoding == "raw":
            # Base64 has a header of its own before compressed data.
            cut = block.index(b"=") + len(b"==") if squeeze is deflated else 0
            block = b"".join(base64.b64decode(part) for part in (block[:cut], block[cut:]) if part)
        body += block
    if squeeze is deflated:
        text = text.replace("<VTKFile ", '<VTKFile compressor="vtkZLibDataCompressor" ')
    text = text.replace('"at"', '"appended"').replace("</VTKFile>", "")
    data = f'{text}<AppendedData encoding="{encoding}">\n_'.encode() + body
    (tmp_path / "network.vtp").write_bytes(data + b"\n</AppendedData></VTKFile>")
    network = read_network(tmp_path / "network.vtp", "mm")
    assert network.lengths() == pytest.approx([10.0, 10.0, 8.0])
    assert network.radius.tolist() == [2, 2, 2, 2, 1, 1]


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("not xml", "not XML"),
        ("<VTKFile type='UnstructuredGrid'/>", "PolyData"),
        (document(name="thickness"), "thickness"),
        (document(radius="2 2 2 1"), "4 values for 5 points"),
        (document(radius="2 2 0 1 1"), "point 2"),
        (document(points=POINTS.replace("8", "nan")), "point 4"),
        (document(offsets="1 5"), "fewer than two points"),
        (document(connectivity="0 1 2 3 9"), "aren't there"),
        (document(connectivity="", offsets=""), "no lines"),
        (document(points=POINTS.replace("8", "x")), "can't be read"),
        (document(form="appended"), "numbers of Points can't be read"),
        (document(form="carved"), "data mode carved isn't known"),
        (document(attributes='compressor="vtkLZ4DataCompressor"'), "vtkLZ4DataCompressor"),
        (
            document(cells='<DataArray type="Int64" Name="kind" format="ascii">0 9</DataArray>'),
            "kind goes from 0 to 9",
        ),
    ],
)
def test_what_cannot_be_read_is_told(tmp_path: Path, text: str, word: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(NetworkError, match=word) as caught:
        read_network(path, "mm")
    assert str(path) in str(caught.value)


def test_no_entity_is_followed(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("1 1 1 1 1")
    entity = f'<!DOCTYPE x [<!ENTITY s SYSTEM "{(tmp_path / "secret").as_uri()}">]>'
    path = written(tmp_path, entity + document(radius="&s;"))
    with pytest.raises(NetworkError):
        read_network(path, "mm")


# SimVascular's paths, read as its own reader does.


def fork() -> VesselNetwork:
    nodes = [[0, 0, 0], [0, 0, 10], [0, 5, 15], [0, -2, 14]]
    return network(nodes, [[0, 1], [1, 2], [1, 3]], [1.0, 0.5, 0.8])


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
    (tmp_path / "refused").mkdir()
    with pytest.raises(NetworkError, match="spacing_mm"):
        write_simvascular_paths(tmp_path / "refused", fork(), spacing_mm=0.0)
    assert list((tmp_path / "refused").iterdir()) == []


@settings(deadline=None, max_examples=examples(40))
@given(net=networks)
def test_every_vessel_is_in_one_run_that_follows_the_flow(net: VesselNetwork) -> None:
    runs = vessel_runs(net)
    assert sorted(i for run in runs for i in run) == list(range(net.vessel_count))
    for run in runs:
        for one, two in pairwise(run):
            assert net.vessel_nodes[one, 1] == net.vessel_nodes[two, 0]


def test_the_normal_is_that_of_a_path_written_by_simvascular() -> None:
    tangent = np.array(
        [
            [0.459604696925632, 0.399318918662815, -0.793289306471389],
            [0.6, 0.8, 0.0],
            [1.0, 0.0, 0.0],
        ]
    )
    wanted = [[0, 0.89321949067228, 0.449620886395586], [0.8, -0.6, 0.0], [0, 0, 1]]
    np.testing.assert_allclose(_normals(tangent), wanted, atol=1e-9)
