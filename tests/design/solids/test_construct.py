"""Constructs: bodies minus lumens, open where they should be."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh

from design.errors import SolidError
from design.geometry.crossings import find_crossings
from design.solids import (
    Solid,
    block_solid,
    construct_genus,
    construct_solid,
    lumen_solid,
    open_ends,
    solid_from_surface,
    surface_genus,
)
from design.solids.check import check_made
from design.solids.local_subtract import subtract_near
from design.solids.ports import depths
from tests.design.solids.networks import channels, ladder

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


def test_a_lumen_without_port_is_a_cavity() -> None:
    network = channels([[3, 4, 1.5], [9, 4, 1.5]], [(0, 1)], 0.4)
    assert open_ends(network, block(), 1.0).tolist() == []
    construct = construct_solid(block(), lumen_solid(network))
    assert surface_genus(construct.faces) == (construct_genus(network, np.array([])), 2)


def test_ends_below_the_surface_or_along_it_stay_closed() -> None:
    nodes = [[0, 4, 1.5], [8, 4, 1.5], [8, 7, 1.5], [8, 4, 2.9], [12, 4, 2.8], [14, 4, 2.8]]
    network = channels(nodes, [(0, 1), (1, 2), (1, 3), (3, 4), (4, 5)], 0.3)
    # 2: ends 1 mm under the side; 5: runs along the top, within a radius of it.
    assert open_ends(network, block(), 0.8).tolist() == [0]


def test_an_end_that_stops_short_of_the_face_by_less_than_its_radius_is_opened() -> None:
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


def test_nothing_left_is_refused() -> None:
    with pytest.raises(SolidError, match="construct is empty"):
        construct_solid(block(), block_solid((18, 10, 5), (-1, -1, -1)))
    with pytest.raises(SolidError, match="three sides above 0"):
        block_solid((1, 0, 2))
    with pytest.raises(SolidError, match="dimple of 0 mm"):
        construct_solid(block(), None, [((0, 0, 0), 0.0)])


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


def test_a_lumen_that_meets_no_face_and_a_body_of_two_shells_are_left_to_it() -> None:
    inner = lumen_solid(channels([[3, 4, 1.5], [9, 4, 1.5]], [(0, 1)], 0.4))
    assert subtract_near(block(), inner, "it") is None
    assert subtract_near(construct_solid(block(), inner), _lumen(), "it") is None


def test_dimples_are_half_balls() -> None:
    plain, marked = construct_solid(block(), None), construct_solid(block(), None, DIMPLES)
    half_balls = 3 * 2 / 3 * np.pi * 0.3**3
    assert plain.volume_mm3 - marked.volume_mm3 == pytest.approx(half_balls, rel=0.02)
    assert marked.volume_mm3 < plain.volume_mm3
