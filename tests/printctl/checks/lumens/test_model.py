"""Lumens of a part without a network, and the part's position."""

from __future__ import annotations

import numpy as np
import pytest
from manifold3d import CrossSection, Manifold

from design.solids import Solid, solid_from_surface
from printctl.checks.lumens import (
    WrittenLines,
    check_model,
    find_leaks,
    find_place,
    measure,
    model_lumens,
    read_lines,
    rounded_to_steps,
)
from printctl.errors import UsageError
from tests.printctl.checks.lumens.small_gcode import (
    LAYER_MM,
    LINE_MM,
    SIDES,
    UL_PER_E,
    gcode,
    ring,
    tube,
)

OUTER = 0.3 + 4 * LINE_MM
LAYERS = 10
PLACE = np.array([20.0, 30.0, 0.0])


def solid(body: Manifold) -> Solid:
    mesh = body.to_mesh()
    return solid_from_surface(
        np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3], np.asarray(mesh.tri_verts)
    )


def disc(radius: float) -> CrossSection:
    return CrossSection.circle(radius, SIDES)


def pipe(layers: int = LAYERS) -> Solid:
    return solid(Manifold.extrude(disc(OUTER) - disc(0.3), layers * LAYER_MM))


def print_of_pipe() -> WrittenLines:
    return read_lines(gcode([tube(0.3, centre=(20, 30))] * LAYERS), UL_PER_E)


def test_a_hole_through_all_layers_is_one_lumen() -> None:
    lines = print_of_pipe()
    stations, trees, unfollowed = model_lumens(pipe(), lines, PLACE)
    assert stations.count == 1
    assert len(stations) == LAYERS
    assert stations.designed_mm == pytest.approx(0.6 * np.cos(np.pi / SIDES), abs=1e-3)
    assert measure(lines, stations).diameter == pytest.approx(0.6, abs=2e-3)
    assert find_leaks(lines, trees, 0.05) == ()
    assert unfollowed == 0


def test_a_level_way_through_the_part_is_told_as_not_checked() -> None:
    tunnel = Manifold.cylinder(4 * OUTER, LAYER_MM, circular_segments=SIDES).rotate((0, 90, 0))
    body = Manifold.extrude(disc(OUTER) - disc(0.3), LAYERS * LAYER_MM)
    beside = Manifold.cube((1.0, 1.0, LAYERS * LAYER_MM)).translate((OUTER - 0.1, -0.5, 0))
    drilled = beside - tunnel.rotate((0, 0, 90)).translate((OUTER + 0.5, -2 * OUTER, 0.3))
    lines = print_of_pipe()
    check = check_model(
        lines, solid(body + drilled), PLACE, rounded_to_steps(lines, (80.0, 80.0)), 0.05
    )
    assert check.unfollowed == 1
    assert check.refusal is not None
    assert "ways through the part that lie level, 1," in check.refusal


def test_a_slit_in_a_tubes_wall_leaks() -> None:
    layers = 30
    open_ = [ring((20, 30), 0.3 + (k + 0.5) * LINE_MM, (-0.4, 0.4)) for k in range(4)]
    written = [open_ if k == 15 else tube(0.3, centre=(20, 30)) for k in range(layers)]
    lines = read_lines(gcode(written), UL_PER_E)
    check = check_model(lines, pipe(layers), PLACE, rounded_to_steps(lines, (80.0, 80.0)), 0.05)
    assert [(leak.into, leak.layer) for leak in check.leaks] == [("outside", 15)]
    assert check.refusal is not None
    assert "leaking: tree 0 into outside in layer 16" in check.refusal


def test_a_part_without_holes_is_refused() -> None:
    with pytest.raises(UsageError, match="no lumen to measure"):
        model_lumens(solid(Manifold.extrude(disc(1), 0.6)), print_of_pipe(), PLACE)


def test_the_place_is_found_from_the_ink() -> None:
    assert find_place(print_of_pipe(), pipe()) == pytest.approx(PLACE, abs=1e-3)


def test_a_skirt_or_another_part_asks_for_the_place() -> None:
    skirt = ring((20, 30), 3.0)
    layers = [[skirt, *tube(0.3, centre=(20, 30))]] * LAYERS
    with pytest.raises(UsageError, match="--place"):
        find_place(read_lines(gcode(layers), UL_PER_E), pipe())
    with pytest.raises(UsageError, match="mm high"):
        find_place(print_of_pipe(), pipe(2 * LAYERS))
