"""Lumen openings and leaks: real ones found, none invented."""

from __future__ import annotations

import numpy as np
import pytest

from design.network import VesselNetwork
from printctl.checks.lumens import Leak, find_leaks, network_trees, read_lines
from tests.printctl.checks.lumens.small_gcode import (
    LAYER_MM,
    LINE_MM,
    UL_PER_E,
    Strokes,
    gcode,
    ring,
    tube,
)

HERE = np.zeros(3)
NONE = np.zeros(3, dtype=np.int64)
LAYERS = 6
TOP = LAYERS * LAYER_MM
APART = 0.3 + 4 * LINE_MM
"""Of the axes of two tubes with four walls each, that touch."""


def network(*at: tuple[float, float]) -> VesselNetwork:
    """Upright vessels of 0.3 mm radius, a tree each."""
    nodes = np.array([[x, y, z] for x, y in at for z in (0.0, TOP)])
    count = len(at)
    return VesselNetwork.from_segments(
        nodes, np.arange(2 * count).reshape(-1, 2), np.full(count, 0.3), NONE[:count],
        np.arange(count) + 10,
    )  # fmt: skip


def leaks(layers: list[Strokes], designed: VesselNetwork, width: float = 0.05) -> tuple[Leak, ...]:
    lines = read_lines(gcode(layers), UL_PER_E)
    return find_leaks(lines, network_trees(designed, lines, HERE), width)


def slit(radius: float, width: float) -> Strokes:
    """A tube whose rings all stand open by ``width`` at angle 0."""
    return [
        ring((0, 0), r, (-half, half))
        for r in (radius + (k + 0.5) * LINE_MM for k in range(4))
        for half in [np.arcsin((width + LINE_MM) / 2 / r)]
    ]


def long_tubes(layers: int = 24) -> VesselNetwork:
    """Long enough that its ports are far from its middle."""
    nodes = np.array([[0, 0, 0], [0, 0, layers * LAYER_MM]], dtype=float)
    return VesselNetwork.from_segments(
        nodes, np.array([[0, 1]]), np.array([0.3]), NONE[:1], np.array([7])
    )


def test_a_tight_tube_doesnt_leak_through_its_ports() -> None:
    assert leaks([tube(0.3)] * LAYERS, network((0, 0))) == ()


def test_a_slit_as_wide_as_a_leak_is_found_where_it_is() -> None:
    layers = [slit(0.3, 0.15) if k == 12 else tube(0.3) for k in range(24)]
    (leak,) = leaks(layers, long_tubes())
    assert (leak.tree, leak.into, leak.layer) == ("7", "outside", 12)
    assert leak.at_mm[0] == pytest.approx(0.35, abs=0.1)
    assert leak.at_mm[1] == pytest.approx(0.0, abs=0.1)


def test_a_slit_too_narrow_is_none() -> None:
    layers = [slit(0.3, 0.03) if k == 12 else tube(0.3) for k in range(24)]
    assert leaks(layers, long_tubes()) == ()
    assert len(leaks(layers, long_tubes(), width=0.01)) == 1


def test_a_pocket_beside_a_lumen_is_none() -> None:
    """Inner rings stand open, the outermost doesn't."""
    layers = [slit(0.3, 0.15)[:3] + tube(0.3)[3:] if k == 12 else tube(0.3) for k in range(24)]
    assert leaks(layers, long_tubes()) == ()


def test_a_way_over_several_layers_is_found() -> None:
    """Two inner rings open in one layer, two outer ones in the next."""
    tight, open_ = tube(0.3), slit(0.3, 0.2)
    change = {12: open_[:3] + tight[3:], 13: tight[:2] + open_[2:]}
    assert len(leaks([change.get(k, tight) for k in range(24)], long_tubes())) == 1


def test_two_trees_that_open_into_each_other_are_named() -> None:
    nodes = np.array([[x, 0, z] for x in (0.0, 1.8) for z in (0.0, 24 * LAYER_MM)])
    pair = VesselNetwork.from_segments(
        nodes,
        np.array([[0, 1], [2, 3]]),
        np.full(2, 0.3),
        NONE[:2],
        np.array([3, 4]),
    )

    def layer(gap: bool) -> Strokes:
        """A plate of lines along x, left out where the lumens are, and between them."""
        strokes = []
        for y in np.arange(-8, 9) * LINE_MM:
            away = np.sqrt(max(0.45**2 - y * y, 0.0))
            cuts = [-away, away, 1.8 - away, 1.8 + away] if away else []
            if gap and abs(y) < 0.1:
                cuts = [cuts[0], cuts[3]]
            ends = [-1.2, *cuts, 3.0]
            strokes += [
                np.array([[a, y], [b, y]]) for a, b in zip(ends[::2], ends[1::2], strict=True)
            ]
        return strokes

    assert leaks([layer(False)] * 24, pair) == ()
    found = leaks([layer(k == 12) for k in range(24)], pair)
    assert [(leak.tree, leak.into) for leak in found] == [("3", "4"), ("4", "3")]
    assert {leak.layer for leak in found} == {12}
