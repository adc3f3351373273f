"""Lumen openings among known printed lines."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import CrossSection, Manifold

from design.network import VesselNetwork
from design.solids import Solid, solid_from_surface
from firmware_profiles.materials.bead import BeadSection
from gcode.deposit.kernels import stadium_span
from kernels.arrays import FloatArray, IntArray
from printctl.checks.lumens import (
    Leak,
    Openings,
    SectionStations,
    WrittenLines,
    check_model,
    find_leaks,
    find_place,
    measure,
    model_lumens,
    network_lumens,
    network_trees,
    read_lines,
    report_lumens,
    rounded_to_steps,
)
from printctl.checks.lumens.layer_spaces import find_runs, join_runs
from printctl.checks.lumens.stations import slabs_near
from printctl.checks.lumens.width_kernels import first_hit, widest_in_polygon
from printctl.errors import UsageError
from tests.printctl.checks.lumens.small_gcode import (
    LAYER_MM,
    LINE_MM,
    SIDES,
    UL_PER_E,
    Strokes,
    gcode,
    ring,
    tube,
)
from tests.printctl.networks import vessels
from tests.slower import examples

HERE = np.zeros(3)
NONE = np.zeros(3, dtype=np.int64)


def upright(layers: int, radius: float, *at: tuple[float, float], tree: Any = 0) -> VesselNetwork:
    """Upright vessels at places of the plane, or at its origin."""
    top = layers * LAYER_MM
    lines = ([[x, y, 0], [x, y, top]] for x, y in at or [(0.0, 0.0)])
    return vessels(*lines, radius=radius, tree=tree)


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
    network = vessels([[-1, 0, 7 * LAYER_MM], [1, 0, 7 * LAYER_MM]], radius=0.3)
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
        vessels([[0, 0, 0], [top, 0, top]], radius=radius), HERE, LAYER_MM, LINE_MM
    )
    inner = (stations.axis[:, 2] > 0.9) & (stations.axis[:, 2] < top - 0.9)
    found = measure(lines, stations)
    assert np.median(found.diameter[inner]) == pytest.approx(2 * radius - inside, abs=0.012)
    # What round sides leave empty beside the crests, δ/2 all round, is open too.
    notch = 0.0 if bead == "rectangle" else LAYER_MM * (1 - np.pi / 4) / 2
    assert found.area[inner] == pytest.approx(np.pi * (radius + notch) ** 2, rel=0.03)


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


def test_the_ink_s_bead_says_how_wide_a_line_is() -> None:
    data = gcode([tube(0.3), tube(0.3)])
    mean = LINE_MM - LAYER_MM * (1 - np.pi / 4)
    for model, width in (("rectangle", mean), ("ellipse", mean * 4 / np.pi), (20.0, mean + 0.02)):
        found = read_lines(data, UL_PER_E, bead=BeadSection(model)).width
        assert found == pytest.approx(width, abs=2e-5)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"G0 X1\nG0 X2\n", "no move"),
        (b"G1 X1 Z1 E1\nG1 X2 Z2 E2\n", "line 1 writes from z 0 to 1"),
        (b"G0 Z0.06\nG1 X1 E9\nG0 Z0.12\nG1 X2 E99\n", "check what E means"),
    ],
)
def test_what_cant_be_read_is_refused(data: bytes, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        read_lines(data, UL_PER_E)


# --- lumen openings and leaks: real ones found, none invented
LAYERS = 6
TOP = LAYERS * LAYER_MM
"""Of the axes of two tubes with four walls each, that touch."""


def network(*at: tuple[float, float]) -> VesselNetwork:
    """Upright vessels of 0.3 mm radius, a tree each."""
    return upright(LAYERS, 0.3, *at, tree=np.arange(len(at)) + 10)


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


LONG = upright(24, 0.3, tree=7)
"""Long enough that its ports are far from its middle."""


def test_a_tight_tube_doesnt_leak_through_its_ports() -> None:
    assert leaks([tube(0.3)] * LAYERS, network((0, 0))) == ()


def test_a_slit_as_wide_as_a_leak_is_found_where_it_is() -> None:
    layers = [slit(0.3, 0.15) if k == 12 else tube(0.3) for k in range(24)]
    (leak,) = leaks(layers, LONG)
    assert (leak.tree, leak.into, leak.layer) == ("7", "outside", 12)
    assert leak.at_mm[0] == pytest.approx(0.35, abs=0.1)
    assert leak.at_mm[1] == pytest.approx(0.0, abs=0.1)


def test_a_way_over_several_layers_is_found() -> None:
    """Two inner rings open in one layer, two outer ones in the next."""
    tight, open_ = tube(0.3), slit(0.3, 0.2)
    change = {12: open_[:3] + tight[3:], 13: tight[:2] + open_[2:]}
    assert len(leaks([change.get(k, tight) for k in range(24)], LONG)) == 1


def test_two_trees_that_open_into_each_other_are_named() -> None:
    pair = upright(24, 0.3, (0.0, 0.0), (1.8, 0.0), tree=[3, 4])

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


# --- lumens of a part without a network, and the part's position
OUTER = 0.3 + 4 * LINE_MM
LAYERS_MODEL = 10
PLACE = np.array([20.0, 30.0, 0.0])


def solid(body: Manifold) -> Solid:
    mesh = body.to_mesh()
    return solid_from_surface(
        np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3], np.asarray(mesh.tri_verts)
    )


def disc(radius: float) -> CrossSection:
    return CrossSection.circle(radius, SIDES)


def pipe(layers: int = LAYERS_MODEL) -> Solid:
    return solid(Manifold.extrude(disc(OUTER) - disc(0.3), layers * LAYER_MM))


def print_of_pipe() -> WrittenLines:
    return read_lines(gcode([tube(0.3, centre=(20, 30))] * LAYERS_MODEL), UL_PER_E)


def test_a_hole_through_all_layers_is_one_lumen() -> None:
    lines = print_of_pipe()
    stations, trees, unfollowed = model_lumens(pipe(), lines, PLACE)
    assert stations.count == 1
    assert len(stations) == LAYERS_MODEL
    assert stations.designed_mm == pytest.approx(0.6 * np.cos(np.pi / SIDES), abs=1e-3)
    assert measure(lines, stations).diameter == pytest.approx(0.6, abs=2e-3)
    assert find_leaks(lines, trees, 0.05) == ()
    assert unfollowed == 0


def test_a_level_way_through_the_part_is_told_as_not_checked() -> None:
    tunnel = Manifold.cylinder(4 * OUTER, LAYER_MM, circular_segments=SIDES).rotate((0, 90, 0))
    body = Manifold.extrude(disc(OUTER) - disc(0.3), LAYERS_MODEL * LAYER_MM)
    beside = Manifold.cube((1.0, 1.0, LAYERS_MODEL * LAYER_MM)).translate((OUTER - 0.1, -0.5, 0))
    drilled = beside - tunnel.rotate((0, 0, 90)).translate((OUTER + 0.5, -2 * OUTER, 0.3))
    lines = print_of_pipe()
    check = check_model(
        lines, solid(body + drilled), PLACE, rounded_to_steps(lines, (80.0, 80.0)), 0.05
    )
    assert check.unfollowed == 1
    assert check.refusal is not None
    assert "ways through the part that lie level, 1," in check.refusal


def test_a_skirt_or_another_part_asks_for_the_place() -> None:
    skirt = ring((20, 30), 3.0)
    layers = [[skirt, *tube(0.3, centre=(20, 30))]] * LAYERS_MODEL
    with pytest.raises(UsageError, match="--place"):
        find_place(read_lines(gcode(layers), UL_PER_E), pipe())
    with pytest.raises(UsageError, match="mm high"):
        find_place(print_of_pipe(), pipe(2 * LAYERS_MODEL))


# --- lumen kernels (rays, widest circle, connected runs), against slow oracles
coordinate = st.floats(-2, 2, allow_nan=False).map(lambda v: round(v, 4))


def naive_distance(points: FloatArray, line: FloatArray) -> FloatArray:
    """Plan distance of points (n, 2) to a stadium (ends, half width); negative inside."""
    a, b = line[:2], line[2:4]
    way = b - a
    share = np.clip((points - a) @ way / max(float(way @ way), 1e-30), 0, 1)
    found: FloatArray = np.linalg.norm(points - a - share[:, None] * way, axis=1) - line[4]
    return found


def written(line: FloatArray, layer: IntArray, layers: int, mean: FloatArray) -> WrittenLines:
    return WrittenLines(
        line[:, :2].copy(),
        line[:, 2:4].copy(),
        2 * line[:, 4],
        mean,
        layer.astype(np.int64),
        np.linspace(0.0, 0.1 * (layers - 1), layers),
        np.linspace(0.1, 0.1 * layers, layers),
        np.arange(len(line)),
    )


def station(point: FloatArray, reach: float) -> SectionStations:
    one = np.ones(1)
    return SectionStations(
        np.zeros(1, dtype=np.int64),
        point[None],
        np.array([[1.0, 1.0, 1.0]]) / np.sqrt(3),
        one,
        one,
        one * reach,
        one * reach,
        one,
        one > 0,
        ("0",),
    )


@given(*(coordinate for _ in range(8)), st.floats(0.05, 0.6))
def test_a_ray_is_in_a_stadium_where_points_on_it_are(
    px: float, py: float, dx: float, dy: float, x0: float, y0: float, x1: float, y1: float, h: float
) -> None:
    if np.hypot(dx, dy) < 0.01:
        return
    low, high = stadium_span(px, py, dx, dy, x0, y0, x1, y1, h)
    t = np.linspace(-500, 500, 4001)
    t = np.concatenate([t / 100 / np.hypot(dx, dy), t / np.hypot(dx, dy)])
    points = np.array([px, py]) + t[:, None] * [dx, dy]
    away = naive_distance(points, np.array([x0, y0, x1, y1, h]))
    inside = (t >= low) & (t <= high)
    assert (away[inside] < 1e-6).all()
    assert (away[~inside] > -1e-6).all()


@settings(deadline=None, max_examples=examples(60))
@given(st.integers(0, 2**32 - 1), st.sampled_from(["rectangle", "rounded", "ellipse", 15.0]))
def test_a_ray_stops_at_the_first_line_of_any_layer(seed: int, model: Any) -> None:
    """Lines by their own cross-section: as wide at each height as its outline says."""
    rng = np.random.default_rng(seed)
    line = np.column_stack([rng.uniform(-1, 1, (30, 4)), rng.uniform(0.06, 0.1, 30)])
    mean = BeadSection(model).area(2 * line[:, 4], 0.1) / 0.1
    deep = (line[:, 4] - mean / 2) / (1 - np.pi / 4)  # half ellipses that leave this mean
    layer = np.sort(np.append(rng.integers(0, 6, 24), np.arange(6))).astype(np.int64)
    point = np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(0, 0.6)])
    way = rng.normal(size=3) * [1, 1, rng.choice([0.0, 1.0, 9.0])]
    way /= np.linalg.norm(way)
    limit = 1.0
    slabs = slabs_near(written(line, layer, 6, mean), station(point, limit))
    found = first_hit(slabs, point[0], point[1], point[2], way[0], way[1], way[2], limit)
    t = np.linspace(0, limit, 20001)
    at = point + t[:, None] * way
    here = np.floor(at[:, 2] / 0.1)
    away = np.full(len(t), np.inf)
    for k in range(30):
        there = here == layer[k]
        up = at[there][:, 2] / 0.1 - layer[k] - 0.5
        less = deep[k] * (1 - np.sqrt(np.clip(1 - 4 * up**2, 0, 1)))
        away[there] = np.minimum(away[there], naive_distance(at[there][:, :2], line[k]) + less)
    inked = np.flatnonzero(away < 0)
    expected = t[inked[0]] if len(inked) else limit
    assert found <= expected + 1e-4
    # It stops on a line's edge, or where a slab begins, never in the open.
    if found < limit:
        near = np.abs(t - found) < 1e-3
        assert away[near].min() < 1e-3


@settings(deadline=None, max_examples=examples(30))
@given(st.integers(0, 2**32 - 1))
def test_the_widest_circle_is_that_of_a_fine_search(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    away = rng.uniform(0.4, 1.0, 40)
    corner = np.column_stack([away * np.cos(angle), away * np.sin(angle)])
    x, y, radius = widest_in_polygon(corner, 0.0, 0.0, 1.0, 1e-4)
    edges = np.column_stack([np.roll(corner, 1, axis=0), corner, np.zeros(40)])

    def clear(points: FloatArray) -> FloatArray:
        found: FloatArray = np.min([naive_distance(points, edge) for edge in edges], axis=0)
        return found

    grid = np.stack(np.meshgrid(*[np.linspace(-0.35, 0.35, 71)] * 2), axis=-1).reshape(-1, 2)
    inside = np.linalg.norm(grid, axis=1) < 0.3  # of the least corner's chord
    assert radius >= clear(grid[inside]).max() - 1.1e-4
    assert radius == pytest.approx(float(clear(np.array([[x, y]]))[0]), abs=1e-9)


@settings(deadline=None, max_examples=examples(60))
@given(st.integers(0, 2**32 - 1))
def test_runs_join_into_the_spaces_of_a_flood(seed: int) -> None:
    from scipy.ndimage import label

    rng = np.random.default_rng(seed)
    pixels = np.where(rng.random((4, 9, 11)) < 0.45, -1, 0).astype(np.int32)
    group = np.zeros(1, dtype=np.int64)
    runs = [find_runs(layer, group) for layer in pixels]
    first = np.concatenate([[0], np.cumsum([len(r) for r in runs])]).astype(np.int64)
    run = np.concatenate(runs)
    parent = np.arange(len(run))
    used = join_runs(run, first, parent, np.zeros((0, 2), dtype=np.int64))
    assert used == 0
    spaces, count = label(pixels == 0)
    layer = np.searchsorted(first, np.arange(len(run)), side="right") - 1
    of = spaces[layer, run[:, 0], run[:, 1]]
    assert len(np.unique(parent)) == count
    assert len({*zip(parent.tolist(), of.tolist(), strict=True)}) == count
