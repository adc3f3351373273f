"""Tubes with walls, fittings at ports, text and fiducials."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from manifold3d import Manifold

from design.errors import SolidError
from design.geometry import build_triangle_tree
from design.solids import (
    Chamber,
    Connector,
    PlacedConnector,
    block_solid,
    chamber_solid,
    connector_parts,
    cylinder_solid,
    fiducial_places,
    find_ports,
    surface_genus,
    text_solid,
    tube_solid,
    with_connector,
    with_connectors,
    with_text,
)
from design.solids.dimensions import Kind
from design.solids.manifolds import solid_manifold
from design.solids.snap import solid_from_manifold
from design.tissue.grid import enclosed
from tests.design.solids.networks import channels

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


def test_fittings_that_open_into_each_other_are_refused() -> None:
    placed = [
        PlacedConnector(Connector("luer_female", 1.0), np.array([x, 6.0, 6.0]), UP, name=name)
        for x, name in ((4.5, "node 0"), (7.5, "node 2"))
    ]
    with pytest.raises(SolidError, match="node 0 and node 2, 3 mm apart, open into each other"):
        with_connectors(slab(), placed)


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


def test_bad_marks_are_refused() -> None:
    with pytest.raises(SolidError, match="nothing to be seen"):
        text_solid("  ", 1.0, 1.0)
    with pytest.raises(SolidError, match="DejaVu Sans has no '心', '\\\\n'"):
        text_solid("A心\n", 1.0, 1.0)
    with pytest.raises(SolidError, match="along has no length"):
        fiducial_places(np.zeros(3), UP, UP, 5.0)
    with pytest.raises(SolidError, match="wall_mm 0"):
        tube_solid(channels([[0, 0, 0], [1, 0, 0]], [(0, 1)], 0.1), 0.0)


def test_impossible_bodies_are_refused() -> None:
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
