"""Lumen openings among known printed lines."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from design.network import VesselNetwork
from firmware_profiles.bead import BeadSection
from printctl.checks.lumens import (
    Openings,
    SectionStations,
    measure,
    network_lumens,
    read_lines,
    report_lumens,
)
from tests.printctl.checks.lumens.small_gcode import (
    LAYER_MM,
    LINE_MM,
    UL_PER_E,
    Strokes,
    gcode,
    tube,
)

HERE = np.zeros(3)
NONE = np.zeros(3, dtype=np.int64)


def straight(*ends: tuple[float, float, float], radius: float) -> VesselNetwork:
    return VesselNetwork.from_segments(
        np.array(ends), np.array([[0, 1]]), np.array([radius]), NONE[:1], NONE[:1]
    )


def upright(layers: int, radius: float) -> VesselNetwork:
    return straight((0, 0, 0), (0, 0, layers * LAYER_MM), radius=radius)


@pytest.mark.parametrize("radius", [0.1, 0.3, 1.0])
def test_an_upright_lumen_is_as_wide_as_its_innermost_ring_leaves_it(radius: float) -> None:
    lines = read_lines(gcode([tube(radius)] * 8), UL_PER_E)
    stations = network_lumens(upright(8, radius), HERE, LAYER_MM, LINE_MM)
    found = measure(lines, stations)
    assert found.diameter == pytest.approx(2 * radius, abs=1.5e-3)
    assert found.area == pytest.approx(np.pi * radius**2, rel=0.01)


@pytest.mark.parametrize(
    ("bead", "notch"),
    [("rectangle", 0.0), ("rounded", np.hypot(0.03, 3 * LAYER_MM + 0.03) - 0.03 - 3 * LAYER_MM)],
)
def test_a_level_channel_is_a_slot_of_whole_layers(bead: Any, notch: float) -> None:
    """Lines along x leave 0.36 mm between them over six layers, under and over solid ones.

    Between round sides the circle reaches into the notch of two lines, 30 µm from either's middle.
    """
    rows = np.arange(-8, 9) * LINE_MM

    def layer(wide: float) -> Strokes:
        kept = [y for y in rows if abs(y) >= wide]
        return [np.array([[-2.0, y], [2.0, y]]) for y in kept]

    half = 3 * LINE_MM - LINE_MM / 2  # the nearest rows left stand at 3 lines
    layers = [layer(0.0)] * 4 + [layer(2.5 * LINE_MM)] * 6 + [layer(0.0)] * 4
    lines = read_lines(gcode(layers), UL_PER_E, line_mm=LINE_MM, bead=BeadSection(bead))
    network = straight((-1, 0, 7 * LAYER_MM), (1, 0, 7 * LAYER_MM), radius=0.3)
    found = measure(lines, network_lumens(network, HERE, LAYER_MM, LINE_MM))
    assert found.diameter == pytest.approx(6 * LAYER_MM + 2 * notch, abs=2e-3)
    less = LAYER_MM * (1 - np.pi / 4) if notch else 0.0
    area = 6 * LAYER_MM * (2 * half + less) + 4 * half * less / LINE_MM * LAYER_MM / 2
    assert found.area == pytest.approx(area, rel=0.02)


@pytest.mark.parametrize(
    ("bead", "inside"),
    [("rectangle", LAYER_MM / np.sqrt(2)), ("rounded", LAYER_MM * (1 - 1 / np.sqrt(2)))],
)
def test_a_slanted_lumen_is_narrowed_by_the_layers_steps(bead: Any, inside: float) -> None:
    """Rings about an axis at 45°: the stairs' inner edges stand h/2 / √2 inside, on two sides.

    Round sides of radius r, their crests on the designed wall, stand r (1 - 1/√2) inside.
    """
    radius, count = 0.4, 40
    layers = []
    for k in range(count):
        x = (k + 0.5) * LAYER_MM
        turn = np.linspace(0, 2 * np.pi, 97)
        ellipse = np.column_stack([np.sqrt(2) * radius * np.cos(turn), radius * np.sin(turn)])
        normal = np.column_stack([np.cos(turn) / np.sqrt(2), np.sin(turn)])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        layers.append([ellipse + (n + 0.5) * LINE_MM * normal + [x, 0] for n in range(3)])
    lines = read_lines(gcode(layers), UL_PER_E, line_mm=LINE_MM, bead=BeadSection(bead))
    top = count * LAYER_MM
    stations = network_lumens(
        straight((0, 0, 0), (top, 0, top), radius=radius), HERE, LAYER_MM, LINE_MM
    )
    inner = (stations.axis[:, 2] > 0.9) & (stations.axis[:, 2] < top - 0.9)
    found = measure(lines, stations)
    assert np.median(found.diameter[inner]) == pytest.approx(2 * radius - inside, abs=0.012)
    # What round sides leave empty beside the crests, δ/2 all round, is open too.
    notch = 0.0 if bead == "rectangle" else LAYER_MM * (1 - np.pi / 4) / 2
    assert found.area[inner] == pytest.approx(np.pi * (radius + notch) ** 2, rel=0.03)


def test_a_closed_layer_is_found_and_named() -> None:
    fill = [np.array([[-0.4, y], [0.4, y]]) for y in np.arange(-3, 4) * 0.1]
    layers = [[*tube(0.3), *(fill if k == 3 else [])] for k in range(8)]
    lines = read_lines(gcode(layers), UL_PER_E)
    stations = network_lumens(upright(8, 0.3), HERE, LAYER_MM, LINE_MM)
    report = report_lumens(stations, measure(lines, stations), lines, HERE)
    assert report.closed.all()
    assert report.closed_layers[0].tolist() == [3]
    assert report.layer[0] == 3
    assert report.conductance[0] == 0
    assert report.narrowest_mm[0] == 0


def _stations(radius: np.ndarray, own: np.ndarray) -> SectionStations:
    n = len(radius)
    axis = np.column_stack([np.zeros((n, 2)), np.linspace(0.01, 0.05, n)])
    return SectionStations(
        np.zeros(n, dtype=np.int64), axis, np.tile([0.0, 0, 1], (n, 1)), 2 * radius, radius,
        radius, radius, np.full(n, 0.5), own, ("a",),
    )  # fmt: skip


def test_conductance_adds_resistances_of_the_fourth_power() -> None:
    stations = _stations(np.array([0.2, 0.2, 0.2]), np.array([True, True, False]))
    wide = np.array([0.4, 0.3, 0.9])  # the last looks into a fork, and counts as designed
    openings = Openings(wide, stations.axis, np.pi / 4 * wide**2)
    lines = read_lines(gcode([tube(0.3)] * 2), UL_PER_E)
    report = report_lumens(stations, openings, lines, HERE)
    expected = 3 / (1 + (4 / 3) ** 4 + 1)
    assert report.conductance[0] == pytest.approx(expected)
    assert report.conductance_least[0] == pytest.approx(expected)
    assert report.mean_mm[0] == pytest.approx(0.4 * expected**0.25)
    assert report.narrowest_mm[0] == 0.3
