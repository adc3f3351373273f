"""3D flow, comparison of fidelities and matched split, by recipe and command."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from pydantic import ValidationError
from skimage.measure import marching_cubes

from design.errors import FlowError
from design.network import VesselNetwork
from design.solids import Solid, write_ply
from design.solids.manifolds import to_manifold
from kernels.arrays import FloatArray
from printctl.analysis.flow.printed.scanned import blur_squared, scanned_lumen, set_out
from printctl.recipe.parts import ComparePart, FlowPart, ThreeDPart
from tests.design.hemodynamics.three_d.surfaces import faceted_tube, straight
from tests.printctl.analysis.flow.test_flow import SINE
from tests.system.cli import called as printctl

pytest.importorskip("ngsolve")

HEAD = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
FORK = HEAD + (
    "0,0,1,0,0,0,2.5,0,0,0.5,0.5,artery,0\n"
    "1,1,2,2.5,0,0,4.5,0.3,0,0.4,0.4,artery,0\n"
    "2,1,3,2.5,0,0,3,-2,0,0.4,0.4,artery,0\n"
)


@pytest.fixture
def fork(tmp_path: Path) -> Path:
    (tmp_path / "fork.csv").write_text(FORK)
    return tmp_path


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open() as handle:
        return list(csv.DictReader(handle))


def _flow(folder: Path, *options: str) -> dict[str, Any]:
    done = printctl("flow", "fork.csv", "--unit", "mm", "--json", *options, cwd=folder)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def test_one_command_solves_in_3d_and_compares(fork: Path) -> None:
    found = _flow(fork, "--three-d", "--edge-ratio", "0.9", "--compare", "--along-vessel", "1")
    space, compared = found["three_d"], found["comparison"]
    assert space["order"] == 2
    assert space["mass_imbalance"] < 1e-6
    assert space["vessels_without_flow"] == []
    # π r² ℓ of each, less what overlaps at the fork.
    assert 2.5 < space["volume_ul"] < np.pi * (0.25 * 2.5 + 0.16 * (2.022 + 2.062))
    reduced = space["reduced"]
    assert reduced["effective_pressure_off_percent_of_drop"] < 0.5
    assert reduced["nominal_pressure_off_percent_of_drop"] > 1.0
    assert compared["along_vessel"] == 1
    assert compared["3D"]["flow_off_percent_of_inlet"] < 3.0
    rows = _rows(fork / "flow" / "flow_3d.csv")
    flow = [float(row["flow_ml_min"]) for row in rows]
    assert flow[0] == pytest.approx(0.25, rel=1e-6)
    assert flow[1] + flow[2] == pytest.approx(flow[0], rel=1e-6)
    for name in (
        "flow_3d.svg",
        "flow_3d_pressure.svg",
        "flow_streamlines.svg",
        "flow_comparison.svg",
    ):
        ElementTree.parse(fork / "flow" / name)
    assert {row["fidelity"] for row in _rows(fork / "flow" / "flow_comparison.csv")} == {
        "ideal",
        "3D",
    }


@pytest.mark.slow
def test_a_pulse_is_compared_over_its_cycle(fork: Path) -> None:
    found = _flow(fork, "--three-d", "--edge-ratio", "1", "--compare", *SINE, "--steps", "8")
    flow = found["comparison"]["3D"]["flow_off_percent_of_inlet"]
    assert flow < 5.0
    assert (found["three_d"]["steps"], found["three_d"]["estimated_pulse_error"]) == (24, 0.0)
    rows = [r for r in _rows(fork / "flow" / "flow_comparison.csv") if r["fidelity"] == "3D"]
    swing = [float(row["flow_swing_ml_min"]) for row in rows[:3]]
    assert swing[0] == pytest.approx(0.2, rel=0.02)
    assert swing[1] + swing[2] == pytest.approx(swing[0], rel=0.02)


def test_wrong_options_have_a_message_each(fork: Path) -> None:
    for options, said in (
        (("--edge-ratio", "0.5"), "--edge-ratio is for --three-d"),
        (("--along-vessel", "1"), "--along-vessel is for --compare"),
        (("--three-d", "--edge-ratio", "3"), "--edge-ratio: must be at most 1 (is 3.0)"),
        (("--compare",), "give three_d, one_d or compare.lattice, too"),
        (("--ranks-python", "python3"), "--ranks-python is for --ranks"),
    ):
        done = printctl("flow", "fork.csv", "--unit", "mm", *options, cwd=fork)
        assert done.returncode != 0
        assert said in " ".join(done.stderr.split()), options


def test_recipes_refuse_what_is_out_of_bounds() -> None:
    assert ThreeDPart().order == 2
    for bad in ({"edge_ratio": 1.2}, {"order": 4}, {"memory_gb": 0}, {"speed": 1}):
        with pytest.raises(ValidationError):
            ThreeDPart(**bad)
    with pytest.raises(ValidationError):
        ComparePart(points=0)
    assert FlowPart(three_d={}, compare={}).compare == ComparePart()


# --- lumen surface from a scan: true size, ends extended to the ports
RADIUS, LENGTH, STEP, SHRUNK = 0.25, 1.5, 0.025, 0.98


def scanned_block() -> tuple[FloatArray, NDArray[np.int32]]:
    """The surface of gel with a channel along z through it, as voxels see it."""
    across = np.arange(-0.7, 0.7 + STEP / 2, STEP)
    up = np.arange(-0.2, LENGTH + 0.2 + STEP / 2, STEP)
    x, y, z = np.meshgrid(across, across, up, indexing="ij")
    outside = np.maximum(
        np.maximum(np.abs(x), np.abs(y)) - 0.55, np.abs(z - LENGTH / 2) - LENGTH / 2
    )
    gel = np.minimum(np.hypot(x, y) - RADIUS, -outside)
    volume = np.clip(0.5 + gel / STEP, 0.0, 1.0)
    points, faces, _, _ = marching_cubes(volume, 0.5, spacing=(STEP,) * 3)
    points = points.astype(np.float64) + [across[0], across[0], up[0]]
    a, b, c = points[faces].transpose(1, 0, 2)
    turned = np.einsum("fd,fd->", a, np.cross(b, c)) < 0.0
    return points, (faces[:, ::-1] if turned else faces).astype(np.int32)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A scan of a part that shrank by 2 %, stretched onto its design as registration leaves it."""
    points, faces = scanned_block()
    surface = Solid(points / SHRUNK, faces)
    write_ply(
        tmp_path / "deviation.ply",
        surface,
        scalar=np.zeros(len(points)),
        scalar_name="deviation_um",
    )
    rigid, scaled = np.eye(4), np.diag([1.0 / SHRUNK] * 3 + [1.0])
    numbers = {
        "transform_scan_to_part": rigid.tolist(),
        "scaled_scan_to_part": scaled.tolist(),
        "measured_by": {"voxel_um": [25.0, 25.0, 25.0]},
    }
    (tmp_path / "registration.json").write_text(json.dumps(numbers))
    return tmp_path


def designed() -> VesselNetwork:
    """Before it shrank, with the radius that was measured of the print."""
    return straight(RADIUS, LENGTH / SHRUNK)


def test_the_lumen_has_the_print_s_own_size_up_to_its_ends(run: Path) -> None:
    found = scanned_lumen(run, designed())
    assert_allclose(found.network.lengths(), LENGTH, rtol=1e-6)
    assert_allclose(found.network.mean_radius(), RADIUS)
    between = (found.surface.vertices[:, 2] > 0.0) & (found.surface.vertices[:, 2] < LENGTH)
    radius = np.hypot(*found.surface.vertices[between, :2].T)
    assert_allclose(np.median(radius), RADIUS, rtol=0.01)
    # Nothing of the rounded mouths, where the gel's faces are.
    assert radius.max() < 1.05 * RADIUS
    assert found.surface.vertices[:, 2].min() < 0.0
    assert found.surface.vertices[:, 2].max() > LENGTH


def test_a_lumen_that_isn_t_there_is_refused_with_volumes(run: Path) -> None:
    network = straight(RADIUS, LENGTH / SHRUNK).moved(np.array([5.0, 0.0, 0.0]))
    with pytest.raises(FlowError, match="µL of lumen where the measured vessels have"):
        scanned_lumen(run, network)


def test_a_wall_that_blur_moved_inwards_is_set_out_again() -> None:
    squared = 0.03**2
    seen = RADIUS - squared / (2.0 * RADIUS)
    lumen = to_manifold(*faceted_tube(seen, LENGTH, 256, 0.3), "a tube")
    network = straight(RADIUS, LENGTH)
    assert_allclose(blur_squared(lumen, network), squared, rtol=0.03)
    assert_allclose(blur_squared(set_out(lumen, network), network), 0.0, atol=0.03 * squared)
