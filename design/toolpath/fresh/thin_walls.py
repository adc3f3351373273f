"""Lay narrower wall lines in material too thin for two lines of full width."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import shapely

from design.toolpath.fresh.contours import Contours, Samples, measure_room, sample
from design.toolpath.fresh.paths import Paths, Role, gather, join
from kernels.arrays import BoolArray, FloatArray, IntArray


class _ThinPlaces(NamedTuple):
    """How lines in places thinner than two walls are made; lengths in line widths.

    Two walls of width w stand side by side where the material is 2 w thick. Where it is thinner
    their centrelines come nearer to each other than w and would put the same ink down twice. There
    both share what there is; only a lumen's wall keeps its width before an outer one, because the
    lumen is what the print is for.
    """

    samples: int = 4  # per line width, where the clearance is measured
    width_step: float = 0.02  # part by which widths may differ between samples without a point
    # Corners between these miters are tips that walls are drawn out into: 78° to 33°. Blunter ones
    # have no sides that face each other, sharper ones take a line of their own.
    tip_miter: tuple[float, float] = (1.59, 3.5)
    shortest: float = 1.0  # line that is worth a start and a stop
    # A place between walls no longer than this gets a straight line, if it fills so much of the
    # narrowest box round it and is no wider than that.
    straight: float = 3.0
    box_share: float = 0.6
    widest: float = 1.3


THIN: Final = _ThinPlaces()


def wall_paths(centre: Contours, width_mm: float, least: float, level: int) -> Paths:
    """Walls along the centrelines ``centre``, narrower where two of them come near each other.

    What is left between two of them and is too narrow for a line of its own goes to both.

    Parameters
    ----------
    centre : Contours
        Boundary of the material, moved into it by half a width.
    width_mm : float, mm
    least : float
        Narrowest line that can be written, in widths.
    level : int
        0 for the walls that touch the boundary.
    """
    reach = 0.5 * width_mm * (1 + least)
    rough = sample(centre, width_mm)
    near, _ = measure_room(rough, reach)
    narrow = np.zeros(len(centre), dtype=np.bool_)
    narrow[rough.contours.ring[(near < reach * (1 - 1e-6)) | _tips(rough)]] = True
    plain = [_ring(centre, k) for k in np.flatnonzero(~narrow).tolist()]
    parts = [
        gather(
            plain,
            [np.full(len(ring), width_mm) for ring in plain],
            closed=True,
            role=Role.WALL,
            level=level,
        )
    ]
    if narrow.any():
        fine = sample(centre, width_mm / THIN.samples)
        parts += _shared(fine, narrow, width_mm, least, level, reach)
    return join(parts)


def _shared(
    fine: Samples, narrow: BoolArray, width: float, least: float, level: int, reach: float
) -> list[Paths]:
    room, other = measure_room(fine, reach)
    ring, hole = fine.contours.ring, fine.contours.hole
    # The material's thickness less one line's width; where nothing is near, there is room for two.
    rest = np.where(other >= 0, 2 * room, width)
    shared = 0.5 * (width + rest)
    mine, its = hole[ring], hole[ring[np.maximum(other, 0)]]
    first = (level == 0) & (other >= 0) & (mine != its)
    enough = rest >= least * width
    made = np.select(
        [first & mine & enough, first & mine, first & enough, first],
        [np.full_like(rest, width), width + rest, rest, np.zeros_like(rest)],
        shared,
    )
    made[_tips(fine)] = 0.5 * width
    # The line's outer edge stays where it is: on the boundary.
    inward = 0.5 * (made - width)
    points = fine.contours.points + (inward * fine.miter)[:, None] * fine.normal
    rings: list[FloatArray] = []
    ring_widths: list[FloatArray] = []
    runs: list[FloatArray] = []
    run_widths: list[FloatArray] = []
    for k in np.flatnonzero(narrow):
        rows = np.arange(fine.contours.offset[k], fine.contours.offset[k + 1])
        if (made[rows] > 0).all():
            keep = rows[needed_points(points[rows], made[rows], width, closed=True)]
            rings.append(points[keep])
            ring_widths.append(0.5 * (made[keep] + np.roll(made[keep], 1)))
        else:
            for run in _runs(rows, made[rows] > 0):
                keep = run[needed_points(points[run], made[run], width, closed=False)]
                runs.append(points[keep])
                run_widths.append(_of_lines(made[keep]))
    return [
        gather(rings, ring_widths, closed=True, role=Role.WALL, level=level),
        gather(runs, run_widths, closed=False, role=Role.WALL, level=level),
    ]


def _of_lines(made: FloatArray) -> FloatArray:
    """Mean width of the line that comes to each point of a run, from the widths at the points."""
    return np.append(made[:1], 0.5 * (made[1:] + made[:-1]))


def _tips(samples: Samples) -> BoolArray:
    """Corners where the material ends in a tip, which its two sides share: no disc faces them."""
    blunt, sharp = THIN.tip_miter
    return samples.convex & (samples.miter > blunt) & (samples.miter < sharp)


def gap_paths(region: Contours, width_mm: float, least: float, *, between: bool = False) -> Paths:
    """One line along the middle of every place in ``region``, as wide as the place is.

    For places thinner than ``width_mm``. Each disc that touches two sides is taken from the side
    that comes first, so that the middle is written once. ``between`` says that all of them lie
    between walls: short ones are straight lines of their area then, whose ends may lie on a wall.
    """
    fine = sample(region, width_mm / THIN.samples)
    room, other = measure_room(fine, 0.75 * width_mm)
    own = np.arange(len(room))
    here = (other > own) & (2 * room >= least * width_mm)
    points = fine.contours.points + room[:, None] * fine.normal
    lines, widths = [], []
    for k in range(len(region)):
        straight = _straight(_ring(region, k), width_mm, least) if between else None
        if straight is not None:
            lines.append(straight[0])
            widths.append(straight[1])
            continue
        rows = np.arange(fine.contours.offset[k], fine.contours.offset[k + 1])
        closed = bool(here[rows].all()) and len(rows) > 2
        runs = [np.append(rows, rows[0])] if closed else _runs(rows, here[rows])
        parts = [part for run in runs for part in _unbroken(points[run], run, width_mm)]
        for part in _linked(parts, points, width_mm):
            if _length(points[part]) >= THIN.shortest * width_mm:
                keep = part[needed_points(points[part], 2 * room[part], width_mm, closed=False)]
                lines.append(points[keep])
                widths.append(_of_lines(2 * room[keep]))
    return gather(lines, widths, closed=False, role=Role.GAP)


def _linked(parts: list[IntArray], points: FloatArray, width: float) -> list[IntArray]:
    """Runs joined where one goes on as another, and not back along itself.

    The side that comes first changes where the ring begins, and the middle goes on from the other.
    """
    left, made = [part for part in parts if len(part) > 1], []
    while left:
        run = left.pop()
        for _ in range(2):  # at its end, then, turned round, at what was its begin
            for k, other in enumerate(left):
                ways = [way for way in (other, other[::-1]) if _goes_on(points, run, way, width)]
                if ways:
                    del left[k]
                    run = np.concatenate([run, ways[0]])
                    break
            run = run[::-1]
        made.append(run)
    return made


def _goes_on(points: FloatArray, run: IntArray, other: IntArray, width: float) -> bool:
    """Whether ``other`` begins near the end of ``run`` and goes the same way."""
    gap = points[other[0]] - points[run[-1]]
    before, after = points[run[-1]] - points[run[0]], points[other[-1]] - points[other[0]]
    return bool(np.hypot(*gap) <= 0.5 * width and before @ after > 0 and gap @ before >= 0)


def _straight(ring: FloatArray, width: float, least: float) -> tuple[FloatArray, FloatArray] | None:
    """A short place's straight line and its widths; None for one that is long, bent or a hole.

    It runs along the narrowest box round the place, through its middle, and holds its area.
    """
    if np.ptp(ring, axis=0).max() > THIN.straight * width:
        return None
    place = shapely.Polygon(ring)
    box = shapely.get_coordinates(shapely.oriented_envelope(place))
    if len(box) < 5 or not shapely.is_ccw(shapely.linearrings(ring)):
        return None
    sides = box[1:3] - box[:2]
    length = np.hypot(sides[:, 0], sides[:, 1])
    long, short = int(length.argmax()), int(length.argmin())
    made = place.area / length[long]
    if length[long] < THIN.shortest * width or place.area < THIN.box_share * length.prod():
        return None
    if not least * width <= made <= THIN.widest * width:
        return None
    across = sides[short] / length[short]
    middle = box[:4].mean(axis=0)
    middle += ((shapely.get_coordinates(place.centroid)[0] - middle) @ across) * across
    half = 0.5 * sides[long]
    return np.stack([middle - half, middle + half]), np.full(2, made)


def needed_points(points: FloatArray, made: FloatArray, width: float, *, closed: bool) -> IntArray:
    """Numbers of the points that a path needs: the others lie on it and change no width."""
    if len(points) < 3:
        return np.arange(len(points))
    before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
    way = after - before
    length = np.maximum(np.hypot(way[:, 0], way[:, 1]), 1e-12)
    out = points - before
    off = np.abs(way[:, 0] * out[:, 1] - way[:, 1] * out[:, 0]) / length
    change = np.maximum(np.abs(made - np.roll(made, 1)), np.abs(np.roll(made, -1) - made))
    needed = (off > 1e-4 * width) | (change > THIN.width_step * width)
    if not closed:
        needed[[0, -1]] = True
    kept = np.flatnonzero(needed)
    return kept if len(kept) >= 3 or not closed else np.arange(len(points))


def _ring(contours: Contours, k: int) -> FloatArray:
    return contours.points[contours.offset[k] : contours.offset[k + 1]]


def _length(points: FloatArray) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _runs(rows: IntArray, keep: BoolArray) -> list[IntArray]:
    """Runs of kept rows round a ring; a run may go over its end."""
    if not keep.any():
        return []
    if keep.all():
        return [rows]
    begin = int(np.flatnonzero(~keep)[0])
    turned, kept = np.roll(rows, -begin), np.roll(keep, -begin)
    places = np.flatnonzero(kept)
    runs = np.split(turned[places], np.flatnonzero(np.diff(places) > 1) + 1)
    return [run for run in runs if len(run) > 1]


def _unbroken(points: FloatArray, run: IntArray, width: float) -> list[IntArray]:
    """Cut a run where the middle jumps from one place to another, or turns back."""
    step = np.diff(points, axis=0)
    cut = np.hypot(step[:, 0], step[:, 1]) > width
    cut[1:] |= (step[1:] * step[:-1]).sum(axis=1) < 0
    return np.split(run, np.flatnonzero(cut) + 1)
