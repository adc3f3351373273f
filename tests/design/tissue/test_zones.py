from __future__ import annotations

import io
import json
import sys
from contextlib import redirect_stdout
from math import pi
from pathlib import Path

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold

from benchmarks.checkers import write_stl
from benchmarks.tissue import worker
from benchmarks.tissue.cases import make, true_volume
from benchmarks.tissue.run import corners_of, judged, welded_volumes
from design.errors import TissueError
from design.tissue import (
    BlockZone,
    CylinderZone,
    MeshZone,
    SphereZone,
    Surface,
    block,
    carve,
    part_numbers,
    part_tissue,
    parts_of,
    tissue_from_surface,
)
from design.vasculature import check_parts
from tests.design.tissue import surfaces
from tests.slower import first_of

CUBE = block((10.0, 10.0, 10.0))
NEEDLE = CylinderZone((2.0, 5.0, -1.0), (8.0, 5.0, 11.0), 0.4)


def closed(shape):
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    return mesh.is_watertight and mesh.is_winding_consistent


@pytest.mark.parametrize(
    ("zone", "volume"),
    [
        (CylinderZone((5, 5, -1), (5, 5, 11), 1.0), 10 * pi),
        (SphereZone((5, 5, 5), 2.0), 32 * pi / 3),
        (BlockZone((9, 9, 9), (1, 1, 1)), 512.0),
        (BlockZone((-5, -5, -5), (5, 5, 5)), 125.0),
    ],
)
def test_zone_takes_its_volume_out(zone, volume):
    found, notes = carve(CUBE, [zone])
    assert notes == ()
    assert closed(found)
    assert 1000 - found.volume_mm3 == pytest.approx(volume, rel=0.01)


def test_a_mesh_takes_its_volume_out():
    ball = surfaces.surface(surfaces.sphere(4.0))
    found, notes = carve(CUBE, [MeshZone(Surface(ball.vertices + 5.0, ball.faces))])
    assert notes == ()
    assert closed(found)
    assert 1000 - found.volume_mm3 == pytest.approx(ball.volume_mm3, rel=0.01)


def test_what_is_kept_free_is_free_and_what_is_kept_within_is_within():
    rng = np.random.default_rng(0)
    way = rng.normal(size=(4000, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    shape = carve(CUBE, [SphereZone((5, 5, 5), 2.0)])[0]
    out = tissue_from_surface(shape.vertices, shape.faces)
    assert not out.contains(5.0 + 1.999 * way).any()
    shape = carve(block((9.0, 9.0, 9.0)), (), [SphereZone((4.5, 4.5, 4.5), 4.0)])[0]
    within = tissue_from_surface(shape.vertices, shape.faces)
    assert not within.contains(4.5 + 4.001 * way).any()


def test_needle_hole_is_outside_and_vessels_keep_clear_of_it():
    shape, _ = carve(CUBE, [NEEDLE])
    tissue = tissue_from_surface(shape.vertices, shape.faces)
    axis = np.linspace(NEEDLE.from_mm, NEEDLE.to_mm, 50)
    assert not tissue.contains(axis).any()
    start, end = np.array([[1.0, 5.0, 5.0]]), np.array([[9.0, 5.0, 5.0]])
    assert not tissue.grid.capsule_inside(start, end, np.array([0.1])).any()


def test_zone_that_misses_is_told():
    found, notes = carve(CUBE, [NEEDLE, SphereZone((30, 0, 0), 1.0)])
    assert notes == (
        "keep_out 2 (sphere) doesn't meet the tissue and changes nothing; check its place",
    )
    assert found.volume_mm3 < 1000.0


def test_tissue_cut_in_two_is_told():
    notes = carve(CUBE, [BlockZone((3, -1, -1), (4, 11, 11))])[1]
    assert len(notes) == 1
    assert "into 2 pieces (66.7 %, 33.3 % of it)" in notes[0]


@pytest.mark.parametrize(
    ("out", "within", "message"),
    [
        ([BlockZone((-1, -1, -1), (11, 11, 11))], [], r"keep_out 1 \(block\) takes the whole"),
        (
            [BlockZone((-1, -1, -1), (6, 11, 11)), BlockZone((5, -1, -1), (11, 11, 11))],
            [],
            "zones together take the whole",
        ),
        ([], [SphereZone((30, 0, 0), 1.0)], "keep_within leaves nothing"),
        ([SphereZone((0, 0, 0), 0.0)], [], "keep_out 1: radius_mm is 0"),
        ([CylinderZone((1, 1, 1), (1, 1, 1), 1.0)], [], "cylinder has no length"),
        ([BlockZone((0, 0, 0), (1, 1, 0))], [], "is flat"),
        ([MeshZone(Surface(CUBE.vertices, CUBE.faces[1:]), "port.stl")], [], r"port\.stl"),
    ],
)
def test_impossible_zones_are_refused(out, within, message):
    with pytest.raises(TissueError, match=message):
        carve(CUBE, out, within)


# Tissues of several parts, and faces without area.


def _joined(*solids):
    found = [surfaces.surface(solid) for solid in solids]
    first = np.cumsum([0, *(len(one.vertices) for one in found)])
    return (
        np.concatenate([one.vertices for one in found]),
        np.concatenate([one.faces + k for one, k in zip(found, first, strict=False)]),
    )


def _tissue(*solids):
    return tissue_from_surface(*_joined(*solids))


SMALL = Manifold.cube((6.0, 6.0, 6.0))
LARGE = Manifold.cube((10.0, 10.0, 10.0))
BESIDE = {
    "apart": SMALL.translate((20.0, 0.0, 0.0)),
    "at a corner": SMALL.translate((10.0, 10.0, 10.0)),
    "at an edge": SMALL.translate((10.0, 10.0, 0.0)),
}


@pytest.mark.parametrize("place", BESIDE)
def test_parts_are_told_apart_even_where_they_touch(place):
    tissue = _tissue(LARGE, BESIDE[place])
    parts = parts_of(tissue)
    assert [round(part.volume_mm3) for part in parts] == [1000, 216]
    middles = np.array([part.middle_mm for part in parts])
    assert part_numbers(tissue, parts, middles).tolist() == [0, 1]


def test_a_part_that_no_vessel_ends_in_is_refused_by_size_and_place():
    tissue = _tissue(LARGE, BESIDE["apart"])
    inside = np.array([[5.0, 5.0, 5.0]])
    with pytest.raises(TissueError, match=r"the part of 216 mm³ around \(23, 3, 3\) mm"):
        check_parts(tissue, inside)
    _, demand, number = check_parts(tissue, np.array([[23.0, 3.0, 3.0], [5.0, 5.0, 5.0]]))
    assert demand == pytest.approx([1000 / 1216, 216 / 1216])
    assert number.tolist() == [1, 0]


def test_a_part_is_a_tissue_of_its_own_with_its_cavities():
    shells = surfaces.nested_shells()
    tissue = tissue_from_surface(shells.vertices, shells.faces)
    outer = parts_of(tissue)[0]
    own = part_tissue(tissue, outer)
    assert own.volume_mm3 == pytest.approx(outer.volume_mm3)
    assert own.contains(np.array([[9.0, 0, 0], [7.0, 0, 0], [0, 0, 0.0]])).tolist() == [1, 0, 0]


# A handful of the battery's tissues (`make bench-tissue` has three hundred).

KINDS = ("point", "inverted", "shells", "sheets", "edge", "face", "flat", "joints", "voxels")


@pytest.mark.parametrize("kind", first_of(KINDS, 2))
def test_every_part_is_supplied(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case, path = make(kind, 0), tmp_path / f"{kind}-0.stl"
    write_stl(path, corners_of(case.mesh))
    # Here, not in a process of its own as the benchmark does: that imports all of it once more.
    monkeypatch.setattr(sys, "argv", ["worker", str(path)])
    with redirect_stdout(io.StringIO()) as told:
        worker.main()
    lines = map(json.loads, told.getvalue().splitlines())
    said = {one["done"]: one for one in lines if "done" in one}
    found = judged(case, said[path.stem], path)
    assert found["result"] == "supplied", found


@pytest.mark.parametrize("kind", ["apart", "many", "sizes", "linked"])
def test_the_judges_parts_are_those_of_the_file(kind: str) -> None:
    case = make(kind, 1)
    true = sorted((true_volume(part) for part in case.parts), reverse=True)
    assert welded_volumes(case.mesh) == pytest.approx(true, rel=1e-4)


def test_a_cavity_is_no_part_and_what_lies_in_it_is_one():
    shells = surfaces.nested_shells()
    tissue = tissue_from_surface(shells.vertices, shells.faces)
    outer, inner = parts_of(tissue)
    assert outer.volume_mm3 + inner.volume_mm3 == pytest.approx(tissue.volume_mm3)
    at = np.array([[9.0, 0, 0], [7.0, 0, 0], [4.5, 0, 0], [0, 0, 0.0]])
    assert part_numbers(tissue, (outer, inner), at).tolist() == [0, -1, 1, -1]
