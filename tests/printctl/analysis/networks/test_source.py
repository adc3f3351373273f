import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from design.hemodynamics import solve_flow, write_flow_csv
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.vasculature import planar_four_vessel
from printctl.analysis.networks import Drive, Source, load_source, with_flow
from printctl.errors import UsageError
from registration.report.picture import VesselQuantities

DRIVE = Drive(0.5, 4.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """As a run leaves it, as far as it matters here."""
    network = planar_four_vessel()
    write_network_csv(tmp_path / "network.csv", network)
    write_flow_csv(tmp_path / "flow.csv", network, solve_flow(network, DRIVE.conditions()))
    box = trimesh.creation.box(bounds=[[0, 0, 0], [16, 8, 3]])
    box.export(tmp_path / "tissue.stl")
    gauged = {"vessels": [{"vessel": 2, "error_percent": -3.0, "rms_um": None}]}
    (tmp_path / "registration.json").write_text(json.dumps(gauged))
    return tmp_path


def test_a_run_brings_all_that_is_known_of_it(folder: Path) -> None:
    source = load_source(folder, None, Drive())
    assert source.network.vessel_count == planar_four_vessel().vessel_count
    # The run's own flow, not one solved for with the drive of the command line.
    assert source.known.flow["flow_ml_min"].max() == pytest.approx(0.5)
    assert source.known.gauged["error_percent"][2] == -3.0
    assert list(source.known.gauged) == ["error_percent"]
    assert source.surface is not None
    assert source.notes == ()


def test_a_flow_of_another_network_is_left_out_and_told(folder: Path) -> None:
    lines = (folder / "flow.csv").read_text().splitlines()
    (folder / "flow.csv").write_text("\n".join(lines[:-1]) + "\n")
    source = load_source(folder, None, Drive())
    assert any("flow.csv isn't that of network.csv" in note for note in source.notes)
    assert any("0.25 mL/min" in note for note in source.notes)
    assert source.known.flow["flow_ml_min"].max() == pytest.approx(0.25)


def test_a_number_typed_takes_the_place_of_a_run_s_own_and_the_rest_stays(folder: Path) -> None:
    """The flow that wasn't typed was the default's, not the run's."""
    recipe = {
        "schema": 1,
        "name": "planar",
        "print_scale": 2,
        "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
        "vasculature": {"design": "planar_four_vessel"},
        "flow": {"inlet_flow_ml_min": 0.5, "viscosity_mpa_s": 3},
    }
    facts = {"schema": 1, "facts": {"recipe": recipe}, "stages": {}}
    (folder / "manifest.json").write_text(json.dumps(facts))
    typed = load_source(folder, None, Drive(viscosity_mpa_s=6.0))
    assert typed.known.flow["flow_ml_min"].max() == pytest.approx(4.0)
    assert "4 mL/min in all of 6 mPa·s" in typed.notes[0]
    (folder / "flow.csv").unlink()
    own = load_source(folder, None, Drive())
    assert typed.known.flow["wall_shear_pa"] == pytest.approx(2 * own.known.flow["wall_shear_pa"])


@pytest.mark.parametrize("text", ["{", "[]", '{"vessels": 3}', '{"vessels": ["x"]}'])
def test_a_broken_registration_is_left_out_and_told(folder: Path, text: str) -> None:
    (folder / "registration.json").write_text(text)
    source = load_source(folder, None, Drive())
    assert source.known.gauged == {}
    assert any("registration.json" in note for note in source.notes)


def test_folders_that_are_no_runs_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no network\.csv"):
        load_source(tmp_path, None, Drive())
    with pytest.raises(UsageError, match="doesn't exist"):
        load_source(tmp_path / "nothing", None, Drive())


def test_a_run_is_in_mm(folder: Path) -> None:
    with pytest.raises(UsageError, match="drop --unit"):
        load_source(folder, "cm", Drive())


def test_a_network_without_an_outlet_has_no_flow_and_it_is_told() -> None:
    ring = VesselNetwork.from_segments(
        np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]),
        np.array([[0, 1], [1, 2], [2, 0]]),
        np.full(3, 0.1),
        np.zeros(3),
        np.zeros(3),
    )
    source = with_flow(Source("ring", ring, VesselQuantities(), None, ()), Drive())
    assert source.known.flow == {}
    assert source.notes[0].startswith("No flow: ")
    assert source.network is ring


def test_lines_through_one_trunk_are_read_as_one_vessel_and_said(tmp_path: Path) -> None:
    path = tmp_path / "lines.csv"
    path.write_text(
        "x,y,z,radius,parent\n"
        "0,0,0,1,-1\n0,0,10,1,0\n6,0,16,0.7,1\n"
        "0,0,0,1,-1\n0,0,4,1,3\n0,0,10,1,4\n-6,0,16,0.7,5\n"
    )
    source = load_source(path, "mm", None)
    assert source.network.vessel_count == 3
    assert source.known.flow == {}
    (note,) = source.notes
    assert "1 of 2 merged with others over 10 mm" in note
