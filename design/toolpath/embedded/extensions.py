"""Find ink that the needle's shaft would hit if a writing stroke were extended past its end."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from design.toolpath.embedded.elements import Elements, ElementSquares, near
from design.toolpath.embedded.needle import Needle, joint_reach, off_shaft, radius_at
from design.toolpath.embedded.rules import TIPS, Meetings, depth_at, flat_gap, of_one_joint
from kernels import jit
from kernels.arrays import FloatArray, IntArray

NEVER: Final = 1 << 40
"""When an element is written that isn't."""


class Extension(NamedTuple):
    """A short straight way beyond the end of a pass, as thick as the vessel there.

    Attributes
    ----------
    start, tip : (3,) float64, mm
    radius : float, mm
    vessel : int
    at : float, mm
        Way along the vessel to where it begins.
    step : int
        1 where it leads on along the vessel's order, -1 where against it.
    far : float, mm
        Way along the vessel to its other end, where it leads past one; else inf.
    """

    start: FloatArray
    tip: FloatArray
    radius: float
    vessel: int
    at: float
    step: int
    far: float


@jit
def barring(
    extension: Extension,
    before: int,
    when: IntArray,
    elements: Elements,
    squares: ElementSquares,
    meetings: Meetings,
    needle: Needle,
) -> IntArray:
    """Elements of passes before the one numbered `before` that its shaft meets; ``when`` (n,)."""
    met = [0][:0]
    for place in _places(extension, 0.5 * needle.tip_mm):
        way = place - extension.start
        at = extension.at + extension.step * np.sqrt((way * way).sum())
        for k in range(3):
            low, high = near(squares, place, k)
            for m in range(low, high):
                x, y, top, reach = squares.around[m]
                far = (x - place[0]) ** 2 + (y - place[1]) ** 2 >= (needle.shaft_mm + reach) ** 2
                j = squares.member[m]
                if far or top <= place[2]:
                    continue
                if when[j] < before and (
                    depth_at(place, extension.radius, extension.vessel, at, j,
                             elements, meetings, needle, extension.far) > 0.0
                ):  # fmt: skip
                    met.append(j)
    return np.unique(np.array(met, np.int64))


@jit
def barred(
    extension: Extension,
    since: int,
    when: IntArray,
    elements: Elements,
    squares: ElementSquares,
    meetings: Meetings,
    needle: Needle,
) -> IntArray:
    """Elements of the pass numbered `since` and later, which take the shaft through its ink."""
    met = [0][:0]
    for place in _places(extension, squares.pitch):
        for k in range(3):
            low, high = near(squares, place, k)
            for j in squares.member[low:high]:
                if since <= when[j] < NEVER and meets(j, extension, elements, meetings, needle):
                    met.append(j)
    return np.unique(np.array(met, np.int64))


@jit
def _places(extension: Extension, spacing: float) -> FloatArray:
    """Places along it, its tip last, no further apart than the spacing."""
    way = extension.tip - extension.start
    count = int(np.ceil(np.sqrt((way * way).sum()) / spacing))
    places = np.empty((count, 3))
    for k in range(count):
        places[k] = extension.start + way * ((k + 1.0) / count)
    return places


@jit
def meets(
    i: int, extension: Extension, elements: Elements, meetings: Meetings, needle: Needle
) -> bool:
    """Whether the shaft passes through an extension's ink while element i is written."""
    tail, head = elements.point[elements.end[i, 0]], elements.point[elements.end[i, 1]]
    thick = max(elements.radius[i, 0], elements.radius[i, 1])
    reach = joint_reach(needle, max(thick, extension.radius))
    vessel, radius = elements.vessel[i], extension.radius
    top = max(extension.start[2], extension.tip[2]) + radius
    for k in range(TIPS):
        share = k / (TIPS - 1.0)
        tip = tail + share * (head - tail)
        wide = radius_at(needle, max(top - tip[2], 0.0)) + radius
        gap = flat_gap(tip[0], tip[1], extension.start, extension.tip, 0.0, 1.0)
        if top <= tip[2] or gap >= wide:
            continue
        at = elements.arc[i] + share * elements.length[i]
        for ink in _places(extension, 0.25 * needle.tip_mm):
            height = ink[2] + radius - tip[2]
            across = np.hypot(ink[0] - tip[0], ink[1] - tip[1])
            if height <= 0.0 or across >= radius_at(needle, height) + radius:
                continue
            way = ink - extension.start
            there = extension.at + extension.step * np.sqrt((way * way).sum())
            if not of_one_joint(
                vessel, at, extension.vessel, there, reach, meetings, extension.far
            ):
                return True
    return False


class ChosenExtensions(NamedTuple):
    """Extensions chosen so far, ``size[0]`` of them.

    Attributes
    ----------
    place : (n, 2, 3) float64, mm
        Start and tip.
    value : (n, 4) float64
        Radius, way along the vessel, step and far end of `Extension`.
    number : (n, 3) int64
        Vessel, element, and when it is written.
    size : (1,) int64
    """

    place: FloatArray
    value: FloatArray
    number: IntArray
    size: IntArray


def empty_extensions(room: int) -> ChosenExtensions:
    """No extension yet, with room for so many."""
    places, values = np.zeros((room, 2, 3)), np.zeros((room, 4))
    return ChosenExtensions(places, values, np.zeros((room, 3), np.int64), np.zeros(1, np.int64))


def add_extension(kept: ChosenExtensions, extension: Extension, element: int, when: int) -> None:
    """Add one."""
    row = int(kept.size[0])
    kept.place[row] = extension.start, extension.tip
    kept.value[row] = extension.radius, extension.at, extension.step, extension.far
    kept.number[row] = extension.vessel, element, when
    kept.size[0] += 1


@jit
def crossing_extension(
    extension: Extension, when: int, kept: ChosenExtensions, meetings: Meetings, needle: Needle
) -> int:
    """Element of a kept extension of which one's shaft meets the other's ink; -1 for none."""
    for row in range(kept.size[0]):
        start, tip = kept.place[row, 0], kept.place[row, 1]
        room = needle.shaft_mm + extension.radius + kept.value[row, 0]
        room += np.hypot(tip[0] - start[0], tip[1] - start[1])
        room += np.hypot(
            extension.tip[0] - extension.start[0], extension.tip[1] - extension.start[1]
        )
        apart = np.hypot(start[0] - extension.start[0], start[1] - extension.start[1])
        if apart >= room or kept.number[row, 2] == when:
            continue
        other = Extension(
            start, tip, kept.value[row, 0], kept.number[row, 0], kept.value[row, 1],
            int(kept.value[row, 2]), kept.value[row, 3],
        )  # fmt: skip
        if kept.number[row, 2] < when:
            meets_ink = _enters(extension, other, meetings, needle)
        else:
            meets_ink = _enters(other, extension, meetings, needle)
        if meets_ink:
            return int(kept.number[row, 1])
    return -1


@jit
def _enters(later: Extension, earlier: Extension, meetings: Meetings, needle: Needle) -> bool:
    """Whether the shaft that writes one extension passes through the ink of another."""
    reach = joint_reach(needle, max(later.radius, earlier.radius))
    for tip in _places(later, 0.25 * needle.tip_mm):
        way = tip - later.start
        at = later.at + later.step * np.sqrt((way * way).sum())
        for ink in _places(earlier, 0.25 * needle.tip_mm):
            across = np.hypot(ink[0] - tip[0], ink[1] - tip[1])
            if off_shaft(across, ink[2] - tip[2], needle) >= earlier.radius:
                continue
            way = ink - earlier.start
            there = earlier.at + earlier.step * np.sqrt((way * way).sum())
            if not of_one_joint(
                later.vessel, at, earlier.vessel, there, reach, meetings, earlier.far, later.far
            ):
                return True
    return False
