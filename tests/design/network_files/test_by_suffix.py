"""Network files: format chosen by suffix, units never guessed."""

from pathlib import Path

import numpy as np
import pytest

from design import planar_four_vessel, read_network, write_network
from design.errors import NetworkError
from design.network import VesselKind
from design.network_files.by_suffix import read_with_notes


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
