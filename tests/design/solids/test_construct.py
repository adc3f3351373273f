"""Constructs: bodies minus lumens, walls, fittings, text; STEP as Open CASCADE reads it back."""

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold

from design.errors import SolidError
from design.geometry import build_triangle_tree
from design.geometry.crossings import find_crossings
from design.solids import (
    Chamber,
    Connector,
    PlacedConnector,
    Solid,
    block_solid,
    chamber_solid,
    connector_parts,
    construct_genus,
    construct_solid,
    cylinder_solid,
    fiducial_places,
    find_ports,
    lumen_solid,
    open_ends,
    solid_from_surface,
    surface_genus,
    text_solid,
    tube_solid,
    with_connector,
    with_connectors,
    with_text,
    write_step,
)
from design.solids.dimensions import Kind
from design.solids.files.check import check_made
from design.solids.files.step import MAX_PIECES, step_pieces
from design.solids.local_subtract import subtract_near
from design.solids.manifolds import solid_manifold
from design.solids.ports import depths
from design.solids.snap import solid_from_manifold
from design.tissue.grid import enclosed
from tests.design.solids.networks import channels, ladder, lattice, vessel

DIMPLES = [((1.5, 1, 3), 0.6), ((14.5, 1, 3), 0.6), ((1.5, 7, 3), 0.6)]


@cache
def block() -> Solid:
    return block_solid((16, 8, 3))


def test_a_bored_block_lacks_the_bores_volume() -> None:
    network = channels([[0, 4, 1.5], [16, 4, 1.5]], [(0, 1)], 0.4)
    lumen = lumen_solid(network, extend_ends_mm=1.0)
    construct = construct_solid(block(), lumen)
    assert construct.volume_mm3 == pytest.approx(384 - np.pi * 0.16 * 16, abs=2e-4)
    assert surface_genus(construct.faces) == (1, 1)


def test_the_ladder_opens_at_both_faces_and_has_the_graphs_handles() -> None:
    network = ladder()
    ports = open_ends(network, block(), 1.0)
    assert ports.tolist() == [0, 11]
    lumen = lumen_solid(network, extend_ends_mm=1.0, extend_nodes=ports)
    construct = construct_solid(block(), lumen, DIMPLES)
    assert construct_genus(network, ports) == 3 + 2 - 1
    assert surface_genus(construct.faces) == (4, 1)
    for axis_point in ([0.0, 4.1, 1.5], [16.0, 4.1, 1.5]):
        assert depths(construct, np.array([axis_point]))[0][0] == pytest.approx(0.5, abs=2e-3)


def test_a_lumen_without_port_is_a_cavity_and_is_left_to_the_whole_cut() -> None:
    network = channels([[3, 4, 1.5], [9, 4, 1.5]], [(0, 1)], 0.4)
    assert open_ends(network, block(), 1.0).tolist() == []
    construct = construct_solid(block(), lumen_solid(network))
    assert surface_genus(construct.faces) == (construct_genus(network, np.array([])), 2)
    inner = lumen_solid(channels([[3, 4, 1.5], [9, 4, 1.5]], [(0, 1)], 0.4))
    assert subtract_near(block(), inner, "it") is None
    assert subtract_near(construct_solid(block(), inner), _lumen(), "it") is None


def test_ends_below_the_surface_stay_closed_but_within_a_radius_of_it_open() -> None:
    nodes = [[0, 4, 1.5], [8, 4, 1.5], [8, 7, 1.5], [8, 4, 2.9], [12, 4, 2.8], [14, 4, 2.8]]
    network = channels(nodes, [(0, 1), (1, 2), (1, 3), (3, 4), (4, 5)], 0.3)
    # 2: ends 1 mm under the side; 5: runs along the top, within a radius of it.
    assert open_ends(network, block(), 0.8).tolist() == [0]
    network = channels([[0.2, 4, 1.5], [8, 4, 1.5]], [(0, 1)], 0.3)
    ports = open_ends(network, block(), 1.0)
    assert ports.tolist() == [0]
    lumen = lumen_solid(network, extend_ends_mm=1.0, extend_nodes=ports)
    assert surface_genus(construct_solid(block(), lumen).faces) == (0, 1)


def test_open_and_inverted_surfaces_are_refused() -> None:
    box = trimesh.creation.box((2, 3, 4))
    with pytest.raises(SolidError, match="3 open edges"):
        solid_from_surface(box.vertices, box.faces[:-1])
    with pytest.raises(SolidError, match="inside out"):
        solid_from_surface(box.vertices, box.faces[:, ::-1])
    flipped = box.faces.copy()
    flipped[0] = flipped[0, ::-1]
    with pytest.raises(SolidError, match="opposed faces"):
        solid_from_surface(box.vertices, flipped)


def test_nothing_left_and_fittings_that_open_into_each_other_are_refused() -> None:
    with pytest.raises(SolidError, match="construct is empty"):
        construct_solid(block(), block_solid((18, 10, 5), (-1, -1, -1)))
    with pytest.raises(SolidError, match="three sides above 0"):
        block_solid((1, 0, 2))
    with pytest.raises(SolidError, match="dimple of 0 mm"):
        construct_solid(block(), None, [((0, 0, 0), 0.0)])
    placed = [
        PlacedConnector(Connector("luer_female", 1.0), np.array([x, 6.0, 6.0]), UP, name=name)
        for x, name in ((4.5, "node 0"), (7.5, "node 2"))
    ]
    with pytest.raises(SolidError, match="node 0 and node 2, 3 mm apart, open into each other"):
        with_connectors(slab(), placed)


# Large lumens subtracted near the surface alone: as by the whole boolean.


def _lumen(fillet: float = 0.5) -> Solid:
    return lumen_solid(ladder(), extend_ends_mm=1.0, fillet_ratio=fillet)


@pytest.mark.parametrize("fillet", [0.0, 0.5])
def test_a_ladder_open_at_both_faces_is_cut_as_by_the_whole_boolean(fillet: float) -> None:
    lumen = _lumen(fillet)
    near, whole = subtract_near(block(), lumen, "it"), construct_solid(block(), lumen)
    assert near is not None
    assert near.volume_mm3 == pytest.approx(whole.volume_mm3, rel=1e-8)
    assert surface_genus(near.faces) == surface_genus(whole.faces)
    assert len(find_crossings(near.vertices, near.faces).pairs) == 0
    assert np.array_equal(near.vertices, near.vertices.astype(np.float32))
    assert check_made(near) is not None


def test_dimples_are_half_balls() -> None:
    plain, marked = construct_solid(block(), None), construct_solid(block(), None, DIMPLES)
    half_balls = 3 * 2 / 3 * np.pi * 0.3**3
    assert plain.volume_mm3 - marked.volume_mm3 == pytest.approx(half_balls, rel=0.02)
    assert marked.volume_mm3 < plain.volume_mm3


# Tubes with walls, fittings at ports, text and fiducials.


UP = np.array([0.0, 0.0, 1.0])


@cache
def slab():
    return block_solid((12, 12, 6))


def test_a_straight_tubes_wall_is_a_ring_over_its_length() -> None:
    network = channels([[0, 0, 0], [0, 6, 8]], [(0, 1)], 0.5)
    solid = tube_solid(network, 0.2)
    assert solid.volume_mm3 == pytest.approx(np.pi * (0.49 - 0.25) * 10.0, rel=2e-3)
    assert surface_genus(solid.faces) == (1, 1)


@pytest.mark.parametrize("ratio", [0.0, 0.5])
def test_a_forks_wall_has_a_hole_less_than_ends(ratio: float) -> None:
    nodes = [[0, 0, 0], [5, 0, 0], [9, 3, 0], [9, -3, 1]]
    network = channels(nodes, [(0, 1), (1, 2), (1, 3)], 0.4)
    solid = tube_solid(network, 0.15, fillet_ratio=ratio)
    assert surface_genus(solid.faces) == (2, 1)


@pytest.mark.parametrize("kind", ["plain", "barb", "luer_female", "luer_male"])
def test_a_fitting_has_one_channel_through_it(kind: Kind) -> None:
    body = with_connector(slab(), Connector(kind, 1.5), np.array([6.0, 6.0, 6.0]), UP)
    # The bore ends 1 mm within: a blind hole, which a lumen opens.
    assert surface_genus(body.faces) == (0, 1)
    assert body.bounds[1, 2] == pytest.approx(16.0, abs=1e-5)
    assert body.volume_mm3 > slab().volume_mm3


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("high", [0, 1])
def test_a_fitting_is_one_body_with_what_it_stands_on_at_every_face(axis: int, high: int) -> None:
    """A rounding error outside of a face at 0 it only touched it, and was a body of its own."""
    size, outward = np.array([12.0, 12.0, 6.0]), np.zeros(3)
    outward[axis] = 2.0 * high - 1.0
    at = 0.5 * size * (1.0 + outward) + 1e-9 * outward
    kinds: tuple[Kind, ...] = ("plain", "barb", "luer_female", "luer_male")
    for kind in kinds:
        body = with_connector(slab(), Connector(kind, 1.5, 4.8), at, outward)
        assert surface_genus(body.faces) == (0, 1)


def test_a_fitting_leaves_its_neighbours_bore_open() -> None:
    ats = [np.array([x, 6.0, 6.0]) for x in (5.4, 6.6)]
    body = with_connectors(
        slab(), [PlacedConnector(Connector("plain", 0.8, 3.0, 4.0), at, UP) for at in ats]
    )
    tree = build_triangle_tree(body.vertices, body.faces.astype(np.int32))
    along = np.linspace(-0.9, 3.9, 25)[:, None] * UP
    assert not enclosed(tree, np.concatenate([at + along for at in ats])).any()
    assert surface_genus(body.faces) == (0, 1)


@pytest.mark.parametrize(("gap", "places"), [(4.0, [6.0, 4.0]), (0.3, [14.0, np.inf])])
def test_a_port_is_where_its_vessel_first_leaves_the_body(gap: float, places: list[float]) -> None:
    """Not on the far side of what stands opposite; a crevice is part of the face."""
    arms = [block_solid((6.0, 12.0, 6.0)), block_solid((8.0 - gap, 12.0, 6.0), (6.0 + gap, 0, 0))]
    body = solid_from_manifold(Manifold.compose([solid_manifold(a, "an arm") for a in arms]), "u")
    network = channels([[1.0, 6, 3], [6, 6, 3]], [(0, 1)], 0.4)
    (port,) = find_ports(network, body, np.array([1]), "the body")
    assert [port.at[0], port.clear_mm] == pytest.approx(places)


def _radius_at(solid_radius: np.ndarray, z: np.ndarray, height: float) -> float:
    return float(solid_radius[np.abs(z - height) < 1e-5].max())


def test_luer_cones_lose_six_percent() -> None:
    for kind, ends in (("luer_male", 0), ("luer_female", 1)):
        parts = connector_parts(Connector(kind, 1.5))  # type: ignore[arg-type]
        solid = parts[ends]
        radius, z = np.hypot(*solid.vertices[:, :2].T), solid.vertices[:, 2]
        if kind == "luer_male":
            wide, narrow = _radius_at(radius, z, 0.0), _radius_at(radius, z, 10.0)
            assert 2 * (wide - narrow) / 10.0 == pytest.approx(0.06, rel=2e-3)
            assert 2 * narrow == pytest.approx(3.9575, abs=0.01)
        else:
            wide, narrow = _radius_at(radius, z, 11.0), _radius_at(radius, z, 2.5)
            assert 2 * (wide - narrow) / 8.5 == pytest.approx(0.06, rel=2e-3)
            opening = 2 * (narrow + (wide - narrow) * 7.5 / 8.5)
            assert 4.270 <= opening <= 4.315


@pytest.mark.parametrize(
    ("connector", "message"),
    [
        (Connector("plain", 7.0), "leaves no wall"),
        (Connector("luer_male", 1.0, length_mm=5.0), "below 7.5 mm"),
        (Connector("luer_female", 4.0), "no bottom"),
        (Connector("barb", 1.0, barbs=0), "at least one"),
        (Connector("plain", 0.0), "above 0"),
    ],
)
def test_impossible_fittings_are_refused(connector: Connector, message: str) -> None:
    with pytest.raises(SolidError, match=message):
        connector_parts(connector)


def test_text_is_raised_or_engraved_by_its_area() -> None:
    text = text_solid("A1", 2.0, 0.4)
    place = (np.array([2.0, 4.0, 6.0]), np.array([1.0, 0, 0]), UP)
    raised = with_text(slab(), text, *place)
    cut = with_text(slab(), text, *place, engraved=True)
    assert raised.volume_mm3 == pytest.approx(slab().volume_mm3 + 0.95 * text.volume_mm3, rel=1e-5)
    assert cut.volume_mm3 == pytest.approx(slab().volume_mm3 - 0.95 * text.volume_mm3, rel=1e-5)
    # "A" has a counter, which goes through the letter and not through the block.
    assert surface_genus(text.faces) == (1, 2)


def test_bad_marks_and_impossible_bodies_are_refused() -> None:
    with pytest.raises(SolidError, match="nothing to be seen"):
        text_solid("  ", 1.0, 1.0)
    with pytest.raises(SolidError, match="DejaVu Sans has no '心', '\\\\n'"):
        text_solid("A心\n", 1.0, 1.0)
    with pytest.raises(SolidError, match="along has no length"):
        fiducial_places(np.zeros(3), UP, UP, 5.0)
    with pytest.raises(SolidError, match="wall_mm 0"):
        tube_solid(channels([[0, 0, 0], [1, 0, 0]], [(0, 1)], 0.1), 0.0)
    with pytest.raises(SolidError, match="ledge_mm 2 must be below"):
        chamber_solid(Chamber("block", (1.0, 1.0, 1.0), wall_mm=2.0, ledge_mm=2.0))
    with pytest.raises(SolidError, match="above 0"):
        cylinder_solid(0.0, 1.0)


def test_a_cylinder_and_chambers_have_their_volumes() -> None:
    assert cylinder_solid(4.0, 5.0).volume_mm3 == pytest.approx(20.0 * np.pi, rel=1e-6)
    box = chamber_solid(Chamber("block", (10.0, 8.0, 5.0), ledge_mm=1.0, ledge_depth_mm=0.5))
    cut = 10 * 8 * 5 + (12 * 10 - 10 * 8) * 0.5
    assert box.volume_mm3 == pytest.approx(14 * 12 * 7 - cut, rel=1e-6)
    assert box.bounds.tolist() == [[-7, -6, -2], [7, 6, 5]]
    dish = chamber_solid(Chamber("cylinder", (10.0, 1.0, 5.0)))
    assert dish.volume_mm3 == pytest.approx(np.pi * (49 * 7 - 25 * 5), rel=1e-5)
    assert surface_genus(dish.faces) == (0, 1)


# STEP.


FORK = channels([[0, 0, 0], [5, 0, 0], [9, 3, 0], [9, -3, 1]], [(0, 1), (1, 2), (1, 3)], 0.4)


def _occ() -> None:
    pytest.importorskip("netgen.occ", reason='the extra "step" isn\'t installed')


def test_pieces_are_frusta_and_balls_each_touching_one_before_it() -> None:
    pieces = step_pieces(FORK)
    assert sum(piece.is_ball for piece in pieces) == 4
    seen = {pieces[0].start.tobytes(), pieces[0].end.tobytes()}
    for piece in pieces[1:]:
        assert {piece.start.tobytes(), piece.end.tobytes()} & seen
        seen |= {piece.start.tobytes(), piece.end.tobytes()}


def test_what_is_too_large_and_a_missing_extra_are_named(tmp_path, monkeypatch):
    monkeypatch.setattr("design.solids.files.step.load_occ", lambda: None)
    with pytest.raises(SolidError, match=f"more than the {MAX_PIECES}"):
        write_step(tmp_path / "a.step", lattice(6, 2.0, 0.3))
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "netgen", None)
    with pytest.raises(SolidError, match=r"pip install 'printctl\[step\]'"):
        write_step(tmp_path / "a.step", FORK)


def test_a_cone_with_round_ends_has_its_exact_volume(tmp_path: Path) -> None:
    _occ()
    check = write_step(tmp_path / "cone.step", vessel([[0, 0, 0], [0, 6, 8]], [0.5, 0.9]))
    frustum = np.pi / 3 * 10 * (0.25 + 0.45 + 0.81)
    caps = 2 / 3 * np.pi * (0.5**3 + 0.9**3)
    assert check.volume == pytest.approx(frustum + caps, rel=3e-3)
    assert (check.solids, check.file) == (1, "cone.step")
    assert (tmp_path / "cone.step").read_text().startswith("ISO-10303-21;")


def test_forks_loops_and_curves_have_the_triangles_volume(tmp_path: Path) -> None:
    _occ()
    turn = np.linspace(0, 1.5, 12)
    bend = vessel(np.stack([3 * np.cos(turn), 3 * np.sin(turn), 0 * turn], 1), 0.4)
    for network in (FORK, ladder(), bend):
        check = write_step(tmp_path / "n.step", network)
        assert check.solids == 1
        assert check.volume == pytest.approx(lumen_solid(network).volume_mm3, rel=2e-3)


def test_a_union_that_lost_a_part_is_refused(tmp_path, monkeypatch):
    _occ()
    monkeypatch.setattr(
        "design.solids.files.step.step_pieces", lambda network: step_pieces(network)[:-2]
    )
    with pytest.raises(SolidError, match="it lost a part"):
        write_step(tmp_path / "a.step", FORK)
    assert not (tmp_path / "a.step").exists()
