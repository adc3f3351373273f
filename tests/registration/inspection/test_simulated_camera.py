"""Sound layers in the simulated camera's pictures: flow control acts on their width ratio."""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.inspection import Appearance, ExpectedLines, SeeingOptions, see_layer
from sim.devices.camera.optics import Camera
from sim.devices.camera.paint import paint
from sim.devices.camera.scene import Bath, InkLook, Scene
from sim.gcode.deposit.lay import Laid, laid_as_is
from sim.gcode.deposit.strands import Strands
from tests.slower import first_of, first_rows

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
    lines = ExpectedLines(
        start, end, np.full(len(off), WIDTH), number, number, np.ones(len(off), dtype=np.bool_)
    )
    found = see_layer(picture, _View(), lines)
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
    lines = ExpectedLines(start, end, np.full(len(start), WIDTH), number, number, new)
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
    lines = ExpectedLines(start, end, np.full(len(new), WIDTH), number, number, new)
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
