"""Divide a network into plain tubes, single junctions and groups of overlapping junctions."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from math import cos, inf, pi, sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from design.network import VesselNetwork
from design.solids.smooth.fillet import wall_distance, wall_rows
from design.solids.tube import Chain, Facets, split_runs
from kernels import jit
from kernels.arrays import FloatArray

End = tuple[int, int]
"""A run, and which of its ends: 0 the first, 1 the last."""
_FILLETS: Final = (1.0, 0.5, 0.25, 0.1, 0.0)
"""Shares of the wanted fillet that are tried where there is little room."""


class _Room(NamedTuple):
    """Lengths of junctions, in radii of the vessel."""

    tube: float = 0.1  # least plain tube between two junctions
    ball: float = 1.05  # from a junction's ball to a group's ring, over the ball's radius
    first_ring: float = 0.5  # least distance of a tube's first ring from the junction
    beyond_fillet: float = 0.2  # from a fillet's rim to that ring
    directions: int = 24  # around a vessel, in which its wall is tried


_ROOM: Final = _Room()


@dataclass
class Layout:
    """Runs, the junctions between them, and how each is made."""

    runs: list[Chain]
    facets: list[int]  # sides of each run's polygon
    ball: FloatArray  # (j,), mm, radius of the widest vessel at each junction
    ends: list[list[End]]  # that meet in each junction
    walls: list[FloatArray]  # rows of `wall_rows` (n, 10) for each junction, infinite
    fillet: list[float]  # mm, at each junction
    fillet_ratio: float = 0.0
    fillet_mm: float | None = None  # counts where it is given
    facets_of: Facets = field(default_factory=Facets)  # tolerance of facets
    # Where the plain tube begins, from the junction at that end, mm.
    reach: dict[End, float] = field(default_factory=dict)
    # Runs without room for a plain tube, which are wholly in a group.
    swallowed: list[bool] = field(default_factory=list)
    # Junctions that failed alone and make a group of their own.
    forced: set[int] = field(default_factory=set)
    # Junctions whose groups failed to be rounded.
    sharp: set[int] = field(default_factory=set)

    def joint_of(self) -> dict[End, int]:
        """Return the junction at each joined end."""
        return {end: joint for joint, ends in enumerate(self.ends) for end in ends}

    def crowded(self, joint: int) -> bool:
        """Return whether a junction is made in a group."""
        return joint in self.forced or any(self.swallowed[run] for run, _ in self.ends[joint])


def lay_out(
    network: VesselNetwork, facets_of: Facets, fillet_ratio: float, fillet_mm: float | None
) -> Layout:
    """Divide a network into runs and junctions; give each junction its fillet and reach."""
    runs, balls = split_runs(network, facets_of)
    facets = [facets_of.count(float(run.radius.max())) for run in runs]
    meeting: dict[bytes, list[End]] = defaultdict(list)
    for index, run in enumerate(runs):
        for end in (0, 1):
            meeting[_key(run.points[-end])].append((index, end))
    ends = [meeting[_key(centre)] for centre in balls.centre]
    walls = [_walls(runs, group) for group in ends]
    wanted = [
        fillet_mm if fillet_mm is not None else fillet_ratio * float(rows[:, 7].min())
        for rows in walls
    ]
    layout = Layout(
        runs, facets, balls.radius, ends, walls, wanted, fillet_ratio, fillet_mm, facets_of
    )
    _give_room(layout)
    return layout


def _key(point: FloatArray) -> bytes:
    return (point + 0.0).tobytes()


def first_piece(run: Chain, end: int) -> tuple[FloatArray, FloatArray, float, float, float]:
    """Return point, unit axis, length, radius and slope of a run's end piece, inwards."""
    one, two = (0, 1) if end == 0 else (-1, -2)
    step = run.points[two] - run.points[one]
    length = float(np.sqrt(step @ step))
    slope = float(run.radius[two] - run.radius[one]) / length
    return run.points[one], step / length, length, float(run.radius[one]), slope


def _walls(runs: list[Chain], ends: list[End]) -> FloatArray:
    pieces = [first_piece(runs[run], end) for run, end in ends]
    start, axis, _, radius, slope = (np.array(column) for column in zip(*pieces, strict=True))
    return wall_rows(start, axis, np.full(len(ends), np.inf), radius, slope)


def _straight(run: Chain, end: int) -> float:
    """Return the first piece's length of straight tube, without the next bend's mitre."""
    _, axis, length, _, _ = first_piece(run, end)
    if len(run.points) == 2:
        return length
    inner = 1 if end == 0 else -2
    after = run.points[2 if end == 0 else -3] - run.points[inner]
    cosine = float(axis @ after) / float(np.linalg.norm(after))
    eaten = run.radius[inner] * np.sqrt(max(0.0, (1.0 - cosine) / (1.0 + cosine)))
    return length - float(eaten)


def _give_room(layout: Layout) -> None:
    """Find which runs are swallowed, then each junction's fillet and reach."""
    least: dict[End, float] = {}
    for ends, rows in zip(layout.ends, layout.walls, strict=True):
        room = np.array([_straight(layout.runs[run], end) for run, end in ends])
        least.update(zip(ends, reaches(rows, 0.0, room).tolist(), strict=True))
    layout.swallowed = [
        _slack(layout, index, least, end) < 0.0 or _slack(layout, index, least, 1 - end) < 0.0
        for index, end in ((index, 0) for index in range(len(layout.runs)))
    ]
    for joint in range(len(layout.ends)):
        _settle(layout, joint, least)


def _slack(layout: Layout, index: int, least: dict[End, float], end: int) -> float:
    """Return the room left at an end when both ends take their least, mm; below 0 if too little."""
    run = layout.runs[index]
    own = least.get((index, end), 0.0)
    gap = _ROOM.tube * float(run.radius.max())
    other = least.get((index, 1 - end), 0.0) if len(run.points) == 2 else 0.0
    return _straight(run, end) - gap - own - other


def _settle(layout: Layout, joint: int, least: dict[End, float]) -> None:
    """Take the largest share of the wanted fillet that leaves all plain tubes room.

    What both ends of a run leave over is shared equally.
    """
    ends, rows, wanted = layout.ends[joint], layout.walls[joint], layout.fillet[joint]
    free = [not layout.swallowed[run] for run, _ in ends]
    room = np.array(
        [
            least[end] + (0.5 if len(layout.runs[end[0]].points) == 2 else 1.0) * slack
            if kept
            else 0.0
            for end, kept in zip(ends, free, strict=True)
            for slack in [_slack(layout, end[0], least, end[1])]
        ]
    )
    for rho in [share * wanted for share in _FILLETS]:
        distances = reaches(rows, rho, room)
        if all(np.isfinite(x) for x, kept in zip(distances.tolist(), free, strict=True) if kept):
            break
    else:
        distances = np.array([least[end] for end in ends])
    layout.fillet[joint] = rho
    for end, x, kept in zip(ends, distances.tolist(), free, strict=True):
        if kept:
            layout.reach[end] = x


def absorb_runs(layout: Layout, more: Iterable[int]) -> None:
    """Make ``more`` runs whole parts of a group."""
    for run in more:
        layout.swallowed[run] = True
        for end in (0, 1):
            layout.reach.pop((run, end), None)


def keep_clear_of_balls(layout: Layout) -> None:
    """Move the rings of groups out of the balls in their junctions; absorb runs without room."""
    joints = range(len(layout.ends))
    while True:
        tight = []
        for joint in joints:
            if not layout.crowded(joint):
                continue
            for run, end in layout.ends[joint]:
                wanted = _ROOM.ball * float(layout.ball[joint])
                if layout.swallowed[run] or layout.reach[run, end] >= wanted:
                    continue
                chain = layout.runs[run]
                other = layout.reach.get((run, 1 - end), 0.0) if len(chain.points) == 2 else 0.0
                gap = _ROOM.tube * float(chain.radius.max())
                if wanted + other + gap <= _straight(chain, end):
                    layout.reach[run, end] = wanted
                else:
                    tight.append(run)
        if not tight:
            return
        absorb_runs(layout, tight)


@jit
def _bound(walls: FloatArray, one: int, rho: float) -> float:
    """Return a distance beyond which no other vessel's ball can touch this one's wall."""
    bound = 0.0
    for other in range(len(walls)):
        if other == one:
            continue
        c = 0.0
        for k in range(3, 6):
            c += walls[one, k] * walls[other, k]
        both = walls[one, 7] + walls[other, 7] + 3.0 * rho
        if c > 0.0:
            across = sqrt(max(0.0, 1.0 - c * c))
            both = both / across if across > 1e-3 else inf
        bound = max(bound, both)
    return 1.2 * bound + walls[one, 7]


@jit
def _holds_another(walls: FloatArray, one: int, x: float) -> bool:
    """Return whether at ``x`` another vessel's axis is still within this one's wall."""
    for other in range(len(walls)):
        c = 0.0
        for k in range(3, 6):
            c += walls[one, k] * walls[other, k]
        if other != one and c > 0.0:
            across = x * sqrt(max(0.0, 1.0 - c * c)) / c
            if across < walls[one, 7] + walls[one, 8] * x:
                return True
    return False


@jit
def _clear(walls: FloatArray, one: int, rho: float, x: float, frame: FloatArray) -> bool:
    """Return whether the ball touches this vessel's wall all around at ``x`` along its axis.

    A vessel that is still inside will come through the wall farther out.
    """
    if _holds_another(walls, one, x):
        return False
    wall = walls[one]
    radius = wall[7] + wall[8] * x
    margin = 0.02 * radius
    for k in range(_ROOM.directions):
        angle = 2.0 * pi * k / _ROOM.directions
        c, s = cos(angle), sin(angle)
        place = np.empty(3)
        for axis in range(3):
            across = c * frame[0, axis] + s * frame[1, axis]
            normal = wall[9] * (across - wall[8] * wall[3 + axis])
            foot = wall[axis] + x * wall[3 + axis]
            place[axis] = foot + radius * across + (rho + margin) * normal
        for other in range(len(walls)):
            if other != one:
                a, _, _, _ = wall_distance(walls[other], place[0], place[1], place[2])
                if a < rho + margin:
                    return False
    return True


@jit
def _clear_from(walls: FloatArray, one: int, rho: float, room: float) -> float:
    """Find the distance along vessel ``one`` from which on no other vessel's fillet touches it.

    Searched inwards, since a thin vessel may leave a wide one's wall late.
    """
    radius = walls[one, 7]
    least, beyond = _ROOM.first_ring * radius, _ROOM.beyond_fillet * radius
    bound = _bound(walls, one, rho)
    x = min(room - beyond, bound)
    frame = across_axis(walls[one, 3:6])
    if x < bound and _holds_another(walls, one, x):
        return inf
    if not least <= x < inf or not _clear(walls, one, rho, x, frame):
        return inf
    step = max(0.1 * radius, 0.05 * (x - least))
    while step > 0.09 * radius:
        while x - step > least and _clear(walls, one, rho, x - step, frame):
            x -= step
        step *= 0.4
    return x + beyond


@jit
def across_axis(axis: FloatArray) -> FloatArray:
    """Return two unit vectors across ``axis``, (2, 3)."""
    helper = np.zeros(3)
    helper[np.argmin(np.abs(axis))] = 1.0
    frame = np.empty((2, 3))
    frame[0] = np.cross(helper, axis)
    frame[0] /= sqrt(np.sum(frame[0] ** 2))
    frame[1] = np.cross(axis, frame[0])
    return frame


@jit
def reaches(walls: FloatArray, rho: float, room: FloatArray) -> FloatArray:
    """Find the distance along each vessel at which it is a plain tube again, (n,), mm.

    Infinite where it isn't within ``room`` (n,). See `wall_rows` for ``walls``.
    """
    distances = np.empty(len(walls))
    for one in range(len(walls)):
        distances[one] = _clear_from(walls, one, rho, room[one])
    return distances
