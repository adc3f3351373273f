import csv

import numpy as np
import pytest
import trimesh

from benchmarks.scans.cases import BRIDGED_AT, BRIDGES, SHARED, WIDEST_MM
from benchmarks.scans.defects import plant
from benchmarks.scans.designs import DESIGNS, Design, block, write_design
from benchmarks.scans.geometry import bscan
from benchmarks.scans.judge import off_lumens
from benchmarks.scans.make import image, piece_boxes
from benchmarks.scans.options import parser
from benchmarks.scans.pose import draw
from benchmarks.scans.rows import SHARED as SHARED_PROGRAM
from benchmarks.scans.rows import shared_designs
from benchmarks.scans.truth import sections
from tests.slower import first_of

STILL = ["--yaw=0", "--tilt=0,0", "--roughness-um=0", "--reflection-db=-90", "--tail=0"]
FLAT = [*STILL, "--attenuation-per-mm=0", "--rolloff-db-mm=0", "--rayleigh-mm=1000", "--snr-db=60"]


def asked(design, *options):
    return parser().parse_args([design, "unused", *options])


def scan(design, options):
    """Intensities, pose."""
    given, rng = asked("compact", *options), np.random.default_rng(0)
    pose = draw(design, given, rng)
    return image(design, plant(design, given), pose, given, rng), pose


@pytest.mark.slow
def test_speckle_of_one_look_of_many_scatterers_is_fully_developed():
    design = Design(block(2.0, 2.0, 1.0))
    design.add(design.node(0, 0.2, 0.5), design.node(0.3, 0.2, 0.5), (0.2,))
    volume, _ = scan(design, [*FLAT, "--shrink", "1,1,1", "--per-cell", "12"])
    gel = volume[15:40, 20:40, 20:40]
    assert gel.mean() == pytest.approx(1.0, abs=0.03)
    assert gel.std() / gel.mean() == pytest.approx(1.0, abs=0.04)


@pytest.mark.slow
def test_many_looks_show_each_wall_where_the_truth_says():
    """A level face by half power along depth, a channel's section by the sum of its gel missing."""
    design = Design(block(1.6, 1.6, 1.2))
    design.add(design.node(0.8, 0, 0.6), design.node(0.8, 1.6, 0.6), (0.5,))
    options = [*FLAT, "--shrink", "1,1,1", "--looks", "100", "--lumen", "0.01", "--bath", "0.01"]
    volume, pose = scan(design, [*options, "--voxel-um", "25,400,12.5"])
    mean = volume[:, 2:4].mean(axis=1)
    column = mean[:, 20:30].mean(axis=1)
    depth = np.arange(len(column)) * 0.0125
    first = int(np.argmax(column > 0.5))
    top = np.interp(0.5, column[first - 1 : first + 1], depth[first - 1 : first + 1])
    true = (pose.transform @ [0.2, 0.8, 1.2, 1])[2]
    assert 1e3 * abs(top - true) < 5
    x, _, z = (pose.transform @ [0.8, 0.8, 0.6, 1])[:3]
    inside = mean[
        int((z - 0.45) / 0.0125) : int((z + 0.45) / 0.0125),
        int((x - 0.45) / 0.025) : int((x + 0.45) / 0.025),
    ]
    area = (1 - inside).sum() * 0.025 * 0.0125
    assert 1e3 * abs(2 * np.sqrt(area / np.pi) - 0.5) < 5


@pytest.mark.slow
def test_true_diameters_are_those_of_the_solid_cut_across(tmp_path):
    given = asked("curved", "--shrink", "1,1,1", "--yaw", "0", "--tilt", "0,0")
    design = DESIGNS["curved"]()
    write_design(design, tmp_path)
    mesh = trimesh.load(tmp_path / "part.stl")
    assert mesh.is_watertight
    truth = sections(
        design, plant(design, given), draw(design, given, np.random.default_rng(0)), given
    )
    for number in (0, 4, 7):
        vessel, row = design.vessels[number], truth[number]
        k = len(row["along_mm"]) // 2
        s = row["along_mm"][k]
        axis = vessel.at(s + 0.02) - vessel.at(s - 0.02)
        cut = mesh.section(plane_origin=vessel.at(s), plane_normal=axis / np.linalg.norm(axis))
        flat, to_3d = cut.to_2D()
        middle = np.linalg.inv(to_3d) @ [*vessel.at(s), 1]
        area = min((p.area for p in map(closed, flat.discrete) if p.holds(middle[:2])), default=0)
        assert 2e3 * np.sqrt(area / np.pi) == pytest.approx(row["diameter_um"][k], abs=2)


@pytest.mark.slow
def test_true_rough_diameters_are_those_of_the_field_that_is_scanned():
    design = Design(block(1.6, 1.6, 1.2))
    design.add(design.node(0.8, 0, 0.6), design.node(0.8, 1.6, 0.6), (0.5,))
    given = asked("compact", *FLAT, "--shrink", "1,1,1", "--roughness-um", "30")
    lumens, pose = plant(design, given), draw(design, given, np.random.default_rng(0))
    (row,) = sections(design, lumens, pose, given)
    shape = (design.body.planes, np.array(design.body.cylinder))
    parts = (lumens.pieces, lumens.radius, lumens.plugs)
    nx, nz = (int(pose.extent[k] / 0.005) for k in (0, 2))
    field = np.empty((2, 3, nx, nz), np.float32)
    counted = []
    for k in (10, 16, 22):
        y = (pose.transform @ [0.8, row["along_mm"][k], 0.6, 1])[1]
        to_part, boxes = np.linalg.inv(pose.transform), piece_boxes(lumens, pose)
        rough = np.array([0.03, 0.11])
        bscan(y, nx, 0.005, nz, 0.005, to_part, boxes, shape, parts, rough, 0, field)
        counted.append(2e3 * np.sqrt((field[0, 0] < 0).sum() * 0.005**2 / np.pi))
    assert [row["rough_diameter_um"][k] for k in (10, 16, 22)] == pytest.approx(counted, abs=2)
    assert np.std(np.subtract(row["rough_diameter_um"], row["diameter_um"])[4:-4]) > 5


@pytest.mark.slow
@pytest.mark.parametrize("design", first_of(["drum", "curved"]))
def test_a_short_plug_closes_a_vessel_of_many_pieces(design):
    given = asked(design, "--plug=1,0.5744,0.1865", "--shrink", "1,1,1")
    made = DESIGNS[design]()
    lumens, pose = plant(made, given), draw(made, given, np.random.default_rng(0))
    row, planted = sections(made, lumens, pose, given)[1], lumens.defects[0]
    along = np.array(row["along_mm"])
    within = np.abs(along - planted["at_mm"]) < planted["length_um"] / 4e3
    assert within.any()
    assert not np.array(row["diameter_um"])[within].any()


class closed:  # noqa: N801
    """A polygon by its corners."""

    def __init__(self, corners):
        self.corners = np.asarray(corners)
        x, y = self.corners.T
        self.area = abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) / 2

    def holds(self, point):
        """Whether the outline goes round a point, by its winding."""
        angle = np.unwrap(np.arctan2(*(self.corners - point).T[::-1]))
        return abs(angle[-1] - angle[0]) > 6


def pieces(network):
    """Straight pieces (start, end, larger radius) of each vessel of a network.csv."""
    found = {}
    with network.open() as file:
        for row in csv.DictReader(file):
            ends = [np.array([float(row[axis + end]) for axis in "xyz"]) for end in "01"]
            radius = max(float(row["radius0_mm"]), float(row["radius1_mm"]))
            found.setdefault(int(row["vessel"]), []).append((*ends, radius))
    return found


def gap_between(way, pieces):
    """Least distance of a way's points (n, 3) from the walls of straight pieces."""
    start, end, radius = (np.array(part) for part in zip(*pieces, strict=True))
    line = end - start
    from_start = way[:, None] - start
    share = np.clip((from_start * line).sum(axis=2) / (line * line).sum(axis=1), 0, 1)
    return (np.linalg.norm(from_start - share[..., None] * line, axis=2) - radius).min()


def bridge(vessels, one, other, place):
    """Points of the way from a place of one vessel to the nearest of another."""
    axes = [
        np.concatenate([np.linspace(a, b, 100) for a, b, _ in vessels[v]]) for v in (one, other)
    ]
    steps = np.linalg.norm(np.diff(axes[0], axis=0), axis=1)
    along = np.concatenate([[0], np.cumsum(steps)])
    start = np.array([np.interp(place * along[-1], along, axis) for axis in axes[0].T])
    end = axes[1][np.linalg.norm(axes[1] - start, axis=1).argmin()]
    return start + np.linspace(0, 1, 200)[:, None] * (end - start)


@pytest.mark.slow
@pytest.mark.parametrize("name", first_of(sorted(BRIDGES)))
def test_no_bridge_runs_through_a_third_vessel_or_outside(name, tmp_path):
    if name in SHARED:
        if not SHARED_PROGRAM.exists():
            pytest.skip("the shared generator isn't there")
        shared_designs(tmp_path / "shared_designs")
        network = tmp_path / "shared_designs" / name / "network.csv"
    else:
        write_design(DESIGNS[name](), tmp_path)
        network = tmp_path / "network.csv"
    vessels, (one, other) = pieces(network), BRIDGES[name]
    for place in np.linspace(*BRIDGED_AT, 9):
        way = bridge(vessels, one, other, place)
        if name not in SHARED:
            planes = DESIGNS[name]().body.planes
            assert (planes[:, 3] - way @ planes[:, :3].T).min() > WIDEST_MM / 2, place
        for third in set(vessels) - {one, other}:
            assert gap_between(way, vessels[third]) > WIDEST_MM / 2, (place, third)


def test_wall_of_a_lumen_that_leaves_aslant_is_no_point_of_the_face():
    along = np.linspace(0, 1, 11)[:, None]
    row = {"place_mm": (along * [1.0, 0.3, 0.0]).tolist(), "designed_along_um": [400.0] * 11}
    wall, face = [1.2, 0.2, 0.0], [1.2, 0.8, 0.0]
    assert off_lumens(np.array([wall, face]), {"vessels": [row]}).tolist() == [False, True]
