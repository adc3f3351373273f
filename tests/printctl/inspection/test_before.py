"""Fresh ink over older ink, told by a picture taken before; the simulated camera's pictures."""

from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gcode.deposit.lay import Laid, laid_as_is
from gcode.deposit.written import Strands
from kernels.arrays import FloatArray
from printctl.inspection import (
    Appearance,
    ExpectedLines,
    LayerFindings,
    SeeingOptions,
    see_layer,
)
from sim.devices.camera.paint import paint
from sim.devices.camera.scene import Bath, Camera, InkLook, Scene
from tests.printctl.inspection.painted import lines_of
from tests.printctl.inspection.stacked_layers import Layer, Stack, stack
from tests.slower import first_of, first_rows

SEEN = 4
"""A translucent stack whose layers add enough density."""


_SHOWN = 3
"""Older layers that the product is told of."""


def expected(found: Stack) -> ExpectedLines:
    """The layer and those below, as the product takes them."""
    layers = [*found.older[-_SHOWN:], found.layer]
    return ExpectedLines(
        np.vstack([_places(one, 0) for one in layers]),
        np.vstack([_places(one, 1) for one in layers]),
        np.concatenate([np.full(len(one.at), one.width) for one in layers]),
        np.arange(sum(len(one.at) for one in layers)),
        np.concatenate([np.arange(len(one.at)) + 1000 * k for k, one in enumerate(layers)]),
        np.repeat(np.arange(len(layers)) == len(layers) - 1, [len(one.at) for one in layers]),
    )


def _places(layer: Layer, which: int) -> np.ndarray:
    return np.hstack([layer.ends()[which], np.full((len(layer.at), 1), 0.3)])


def look(found: Stack) -> LayerFindings:
    """See one painted layer."""
    return see_layer(found.picture, found, expected(found), before=found.before)


@pytest.fixture(scope="module")
def painted() -> Stack:
    return stack(SEEN, "translucent", gaps=2)


def overlapping(found: Stack, stroke: int, begin: float, end: float) -> bool:
    base = 1000 * min(3, len(found.older))
    return any(stroke == base + k and begin < e and end > b for k, b, e in found.gaps)


def test_missing_translucent_ink_over_older_ink_is_found(painted: Stack) -> None:
    findings = look(painted)
    assert findings.seen_share > 0.7
    assert all(overlapping(painted, g.stroke, g.from_mm, g.to_mm) for g in findings.gaps)
    assert len(findings.gaps) == 2
    assert np.isfinite(findings.moved_px)


def test_a_sound_translucent_layer_has_no_gap() -> None:
    findings = look(stack(SEEN, "translucent"))
    assert findings.seen_share > 0.7
    assert not findings.gaps


@pytest.mark.parametrize("kind", first_of(["opaque", "matte"]))
def test_missing_ink_that_adds_no_density_over_itself_never_passes_as_seen(kind: str) -> None:
    there = stack(SEEN, kind, gaps=2)
    findings = look(there)
    assert not findings.gaps
    at, base = findings.stations, 1000 * min(_SHOWN, len(there.older))
    for number, begin, end in there.gaps:
        inside = (at.stroke == base + number) & (at.along_mm > begin) & (at.along_mm < end)
        assert not at.seen[inside].any()


@pytest.mark.parametrize("kind", first_of(["opaque", "translucent"]))
def test_nothing_is_seen_where_nothing_came_over_older_ink(kind: str) -> None:
    """Profiles fitted to noise gave each place a full share of it."""
    there = stack(SEEN, kind)
    noise = np.random.default_rng(5).normal(0.0, 1.0, there.before.shape)
    again = np.clip(np.rint(there.before + noise), 0, 255).astype(np.uint8)
    came, none = (
        see_layer(one, there, expected(there), before=there.before)
        for one in (there.picture, again)
    )
    # Opaque ink over its own kind changes no more than shade does.
    assert kind == "opaque" or came.seen_share > 0.7
    assert not came.gaps
    assert none.seen_share == 0.0
    assert not none.gaps


def test_a_camera_that_moved_by_pixels_is_found_unless_its_marks_stand_still(
    painted: Stack,
) -> None:
    """A part's shadow that grew on black glass "moved" it by 12 px, and a clog in part passed."""
    moved = np.roll(painted.before, (8, -7), axis=(0, 1))
    findings = see_layer(
        painted.picture, painted, expected(painted), before=moved, stood_still=lambda: True
    )
    assert findings.moved_px == 0.0
    findings = see_layer(painted.picture, painted, expected(painted), before=moved)
    assert findings.moved_px > 8.0
    assert not findings.gaps  # over older ink one picture alone tells nothing
    assert findings.seen_share < 0.1


# Sound and broken layers in the simulated camera's pictures.


WIDTH, HEIGHT, SIZE = 0.25, 0.1, 6.0
CAMERA = Camera(
    size_px=(640, 640), um_per_px=13, target_mm=(3, 3, 1), tilt_deg=8, tilt_towards_deg=70,
    turn_deg=12,
)  # fmt: skip
# Bath and ink, and how far off the ratio may be; dark rims make pale ink look narrower.
LOOKS = {
    "pale": ((95.0, 90.0, 85.0), (235.0, 225.0, 220.0), 0.045),
    "coloured": ((110.0, 105.0, 80.0), (240.0, 215.0, 230.0), 0.03),
    "dark": ((172.0, 168.0, 158.0), (60.0, 90.0, 45.0), 0.03),
}


class _View:
    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        return CAMERA.pixels(points_mm)


@pytest.mark.parametrize("density", first_of([8.0, 20.0]))
@pytest.mark.parametrize("look", LOOKS)
def test_a_sound_layers_width_ratio_is_one(look: str, density: float) -> None:
    off = np.arange(0.0, SIZE + 1e-9, 0.7)
    flat = np.column_stack([off, np.ones(len(off))])
    start, end = np.insert(flat, 0, 0.0, axis=1), np.insert(flat, 0, SIZE, axis=1)
    number = np.arange(len(off))
    area = np.full(len(off), (WIDTH - HEIGHT) * HEIGHT + np.pi / 4 * HEIGHT**2)
    ink = laid_as_is(
        Strands(start, end, area * SIZE, area, number, number), "layered", layer_mm=HEIGHT
    )
    bath, colour, most = LOOKS[look]
    scene = Scene(bath=Bath(colour=bath), ink=InkLook(colour=colour, density_per_mm=density))
    picture = paint(ink, CAMERA, scene, 1)
    found = see_layer(picture, _View(), lines_of(start, end, WIDTH))
    assert abs(found.width_ratio - 1.0) < most
    assert abs(found.width_ratio - 1.0) < 2.0 * found.u_width_ratio


def _layers(fresh: int, missing: tuple[int, ...] = ()) -> tuple[Laid, ExpectedLines]:
    """A layer of lines, and over it, across, so many fresh ones; the ink without those missing."""
    off = np.arange(0.0, SIZE + 1e-9, 0.7)
    below = np.column_stack([off, np.full(len(off), 1.0 - HEIGHT)])
    start, end = np.insert(below, 0, 0.0, axis=1), np.insert(below, 0, SIZE, axis=1)
    above = np.column_stack([off[:fresh], np.ones(fresh)])
    start = np.concatenate([start, np.insert(above, 1, 0.0, axis=1)])
    end = np.concatenate([end, np.insert(above, 1, SIZE, axis=1)])
    number, new = np.arange(len(start)), np.arange(len(start)) >= len(off)
    area = np.full(len(start), (WIDTH - HEIGHT) * HEIGHT + np.pi / 4 * HEIGHT**2)
    lies = ~np.isin(number - len(off), missing)
    strands = Strands(
        start[lies], end[lies], area[lies] * SIZE, area[lies], number[lies], number[lies]
    )
    lines = lines_of(start, end, WIDTH, fresh=new)
    return laid_as_is(strands, "layered", layer_mm=HEIGHT), lines


def _scene(look: str) -> Scene:
    bath, colour, _ = LOOKS[look]
    texture = Bath(colour=bath, texture=0.015)
    return Scene(bath=texture, ink=InkLook(colour=colour, density_per_mm=14.0))


@pytest.mark.parametrize("look", first_of(["dark", "coloured"]))
def test_a_line_missing_between_older_lines_is_a_gap(look: str) -> None:
    ink, lines = _layers(4, missing=(2,))
    before = paint(_layers(0)[0], CAMERA, _scene(look), 1)
    found = see_layer(paint(ink, CAMERA, _scene(look), 2), _View(), lines, before=before)
    stroke = int(lines.stroke[lines.fresh][2])
    assert {gap.stroke for gap in found.gaps} == {stroke}
    between = np.arange(0.35, SIZE, 0.7)  # of each two older lines
    hit = [any(gap.from_mm < at < gap.to_mm for gap in found.gaps) for at in between]
    assert sum(hit) >= len(between) - 1


def _lattice(fresh: int, missing: tuple[int, ...] = ()) -> tuple[Laid, ExpectedLines]:
    """Four layers across each other, the upper two half a pitch aside; so many of the last."""
    starts, ends = [], []
    for layer in range(4):
        off = np.arange(0.35 * (layer // 2), SIZE + 1e-9, 0.7)[: fresh if layer == 3 else None]
        flat = np.column_stack([off, np.full(len(off), 1.0 + (layer - 3) * HEIGHT)])
        starts.append(np.insert(flat, layer % 2, 0.0, axis=1))
        ends.append(np.insert(flat, layer % 2, SIZE, axis=1))
    new = np.arange(sum(map(len, starts))) >= sum(map(len, starts[:3]))
    start, end, number = np.concatenate(starts), np.concatenate(ends), np.arange(len(new))
    area = np.full(len(new), (WIDTH - HEIGHT) * HEIGHT + np.pi / 4 * HEIGHT**2)
    lies = ~np.isin(number - (~new).sum(), missing)
    strands = Strands(
        start[lies], end[lies], area[lies] * SIZE, area[lies], number[lies], number[lies]
    )
    lines = lines_of(start, end, WIDTH, fresh=new)
    return laid_as_is(strands, "layered", layer_mm=HEIGHT), lines


@cache
def _seen_before(look: str) -> tuple[Appearance | None, NDArray[Any]]:
    """What a flat print's layer showed of the ink, and the picture before the lattice's last."""
    known, flat = _layers(4)
    older = paint(_layers(0)[0], CAMERA, _scene(look), 4)
    first = see_layer(paint(known, CAMERA, _scene(look), 3), _View(), flat, before=older)
    return first.appearance, paint(_lattice(0)[0], CAMERA, _scene(look), 1)


MISSING = {"sound": (), "one": (1,), "all": (0, 1, 2, 3)}
ONCE = [("pale", "sound"), ("coloured", "all")]


@pytest.mark.parametrize(
    ("look", "missed"),
    first_rows([*ONCE, *sorted(set(product(LOOKS, MISSING)) - set(ONCE))], len(ONCE)),
)
def test_missing_lines_of_a_lattices_last_layer_are_gaps(look: str, missed: str) -> None:
    known, before = _seen_before(look)
    missing = MISSING[missed]
    ink, lines = _lattice(4, missing)
    picture = paint(ink, CAMERA, _scene(look), 2)
    options = SeeingOptions(shift_mm=0.1)
    found = see_layer(picture, _View(), lines, before=before, known=known, options=options)
    strokes = lines.stroke[lines.fresh]
    assert {gap.stroke for gap in found.gaps} == set(strokes[list(missing)])
    for k in missing:
        told = sum(gap.length_mm for gap in found.gaps if gap.stroke == strokes[k])
        assert told > 0.9 * SIZE


def test_a_layer_that_is_missing_is_not_seen_by_a_look_that_knows_no_ink() -> None:
    _, before = _seen_before("coloured")
    ink, lines = _lattice(4, MISSING["all"])
    picture = paint(ink, CAMERA, _scene("coloured"), 2)
    found = see_layer(picture, _View(), lines, before=before, options=SeeingOptions(shift_mm=0.1))
    assert found.seen_share == 0.0
    assert not found.gaps
