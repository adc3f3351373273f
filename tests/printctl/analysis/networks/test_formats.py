import io
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image
from rich.console import Console
from typer.testing import CliRunner

from design.errors import NetworkError
from design.hemodynamics import solve_flow, write_flow_csv
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.units import LengthUnit
from design.vasculature import planar_four_vessel
from printctl.analysis.networks import Drive, load_source, read_noted, write_network
from printctl.cli.main import app
from printctl.errors import UsageError
from printctl.pipeline.running.run import design_recipe
from printctl.recipe import parse_recipe
from tests.design.networks import random_network, random_trees

UNITS: dict[str, LengthUnit | None] = {
    ".csv": "mm", ".vtp": "mm", ".swc": None, ".json": None, ".npz": None,
}  # fmt: skip


def same(found: VesselNetwork, network: VesselNetwork, rel: float) -> None:
    """Vessels and their shapes; some formats renumber nodes, and order vessels their own way."""

    def shapes(each: VesselNetwork) -> list[tuple[float, ...]]:
        rows = zip(each.lengths(), each.mean_radius(), each.kind, strict=True)
        return sorted(tuple(np.round([float(v) for v in row], 9)) for row in rows)

    assert found.vessel_count == network.vessel_count
    np.testing.assert_allclose(shapes(found), shapes(network), rtol=rel)


def test_a_format_that_cannot_hold_a_network_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(NetworkError, match="trees only"):
        write_network(tmp_path / "loops.swc", random_network(1, 12))
    assert list(tmp_path.iterdir()) == []


def test_a_failed_folder_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(folder: Path, network: VesselNetwork) -> None:
        (folder / "path_0001.pth").write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("printctl.analysis.networks.write_simvascular_paths", full)
    with pytest.raises(OSError, match="No space"):
        write_network(tmp_path / "Paths", random_trees(3, 9, 2))
    assert list(tmp_path.iterdir()) == []


def test_the_unit_is_asked_for_where_the_format_is_silent(tmp_path: Path) -> None:
    network = random_trees(3, 4, 1)
    for suffix, unit in UNITS.items():
        path = tmp_path / f"a{suffix}"
        write_network(path, network)
        if unit is not None:
            with pytest.raises(UsageError, match="--unit"):
                read_noted(path, None)
        elif suffix != ".swc":
            with pytest.raises(UsageError, match="drop --unit"):
                read_noted(path, "cm")


# --- test_source
DRIVE = Drive(0.5, 4.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """As a run leaves it, as far as it matters here."""
    network = planar_four_vessel()
    write_network_csv(tmp_path / "network.csv", network)
    write_flow_csv(tmp_path / "flow.csv", network, solve_flow(network, DRIVE.conditions(network)))
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


# --- films of growth and of a pulse, read back frame by frame
FOREST: dict[str, Any] = {
    "schema": 1,
    "name": "filmed",
    "tissue": {"shape": "block", "size_mm": [12, 10, 8]},
    "vasculature": {
        "grow": "forest",
        "terminals": 8,
        "networks": [
            {"trees": [{"kind": "artery"}, {"kind": "vein"}]},
            {"trees": [{"kind": "lymph", "terminals": 4}]},
        ],
    },
    "flow": {
        "supplies": [{"trees": [2], "flow_ml_min": 0.01}],
        "pulse": {"amplitude_ml_min": 0.2, "period_s": 1},
    },
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("filmed")
    recipe = parse_recipe(FOREST, "filmed.yaml")
    design_recipe(recipe, folder, folder / "run", Console(file=io.StringIO()), until="flow")
    return folder / "run"


def filmed(*words: str) -> Any:
    return CliRunner().invoke(app, ["film", *words], catch_exceptions=True)


def ink(image: np.ndarray) -> int:
    """Pixels of the picture's left part, without its key, that are far from grey."""
    part = image[40:-40, : 2 * image.shape[1] // 3].astype(int)
    return int((np.ptp(part, axis=2) > 60).sum())


def test_growth_adds_vessels_frame_by_frame(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "growth.gif"
    done = filmed(str(run), "--steps", "4", "--width", "400", "--out", str(out))
    assert done.exit_code == 0, done.output
    with Image.open(out) as film:
        frames = []
        for number in range(film.n_frames):
            film.seek(number)
            frames.append(ink(np.asarray(film.convert("RGB"))))
    assert frames[0] > 0
    assert frames[0] < frames[1] < frames[-1]


def test_a_pulse_returns_to_where_it_began(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "pulse.mp4"
    words = ["--show", "pulse", "--frames", "8", "--cycles", "2", "--width", "300"]
    done = filmed(str(run), *words, "--out", str(out))
    assert done.exit_code == 0, done.output
    film = cv2.VideoCapture(str(out))
    frames = []
    while True:
        read, frame = film.read()
        if not read:
            break
        frames.append(frame[: frame.shape[0] // 2].astype(int))
    assert len(frames) == 16
    assert np.abs(frames[2] - frames[6]).mean() > 2 * np.abs(frames[2] - frames[10]).mean()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--show", "pulse", "--by", "generations"), "--by is for --show growth"),
        (("--out", "film.txt"), "ending in"),
        (("--colour", "taste"), "Invalid value"),
    ],
)
def test_what_would_do_nothing_is_refused(run: Path, words: tuple[str, ...], said: str) -> None:
    done = filmed(str(run), *words)
    assert done.exit_code != 0
    assert said in f"{done.output} {done.exception}"
