"""Truth about a print: sections of the deposited ink along each designed vessel."""

from __future__ import annotations

import csv
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import ndimage

from tests.system.first_part.deposit import Array, Deposit, capsules
from tests.system.first_part.surface import Walls, hits

PIXEL_MM = 0.01
SPACING_MM = 0.1
GRID_MM = 0.04
MAX_CELLS = 3e7
LEAK_MM = 0.06
"""Ways that a ball of this diameter can't take are no leaks."""
OPEN_SHARE = 0.25
"""A lumen whose narrowest section is below this share of the design is closed."""


@dataclass(frozen=True)
class Vessel:
    """A designed vessel: its polyline and radii, and the nodes at its ends."""

    number: int
    points: Array
    radius: Array
    nodes: tuple[int, int]

    @property
    def along(self) -> Array:
        """Length along the axis at each point, mm."""
        return np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))]
        )

    def at(self, along: float) -> tuple[Array, Array, float]:
        """Return place, direction and radius at a length along the axis."""
        k = int(np.clip(np.searchsorted(self.along, along) - 1, 0, len(self.points) - 2))
        step = self.points[k + 1] - self.points[k]
        length = float(np.linalg.norm(step))
        share = (along - self.along[k]) / length
        radius = float(self.radius[k] * (1 - share) + self.radius[k + 1] * share)
        # Where the line bends, a section lies across the chord over one radius.
        chord = self._place(along + radius / 2) - self._place(along - radius / 2)
        return self.points[k] + share * step, chord / np.linalg.norm(chord), radius

    def _place(self, along: float) -> Array:
        return np.array([np.interp(along, self.along, axis) for axis in self.points.T])


@dataclass
class Truth:
    """What the print is."""

    mean_um: dict[int, float] = field(default_factory=dict)
    """Mean diameter of equal area over each vessel's sections, away from joints and mouths."""
    narrowest_um: dict[int, float] = field(default_factory=dict)
    worst_percent: dict[int, float] = field(default_factory=dict)
    """The section farthest from its designed diameter."""
    open: dict[int, bool] = field(default_factory=dict)
    leaks: list[int] = field(default_factory=list)
    """Networks (connected groups) that lead outside other than by a mouth."""
    bridges: list[tuple[int, int]] = field(default_factory=list)
    size_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def sound(self, percent: float = 10.0) -> bool:
        """Return whether everything is open, tight and within the default tolerance."""
        return (
            all(self.open.values())
            and not self.leaks
            and not self.bridges
            and all(abs(one) <= percent for one in self.worst_percent.values())
        )


def read_network(path: Path) -> list[Vessel]:
    """Return the vessels of a run folder's network.csv."""
    pieces: dict[int, list[dict[str, str]]] = {}
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            pieces.setdefault(int(row["vessel"]), []).append(row)
    vessels = []
    for number, rows in pieces.items():
        first, last = rows[0], rows[-1]
        points = [[float(first[a + "0"]) for a in "xyz"]]
        points += [[float(row[a + "1"]) for a in "xyz"] for row in rows]
        radius = [float(first["radius0_mm"])] + [float(row["radius1_mm"]) for row in rows]
        nodes = (int(first["node0"]), int(last["node1"]))
        vessels.append(Vessel(number, np.array(points), np.array(radius), nodes))
    return vessels


def section(deposit: Deposit, vessel: Vessel, along: float, of_ink: bool) -> float | None:
    """Return the diameter of equal area across a vessel, mm; None where no wall bounds it."""
    middle, axis, radius = vessel.at(along)
    across = np.cross(axis, [0, 0, 1] if abs(axis[2]) < 0.9 else [1, 0, 0])
    across /= np.linalg.norm(across)
    up = np.cross(axis, across)
    half = int((1.5 * radius + 0.12) / PIXEL_MM)
    steps = np.arange(-half, half + 1) * PIXEL_MM
    grid = middle + steps[:, None, None] * across + steps[None, :, None] * up
    ink = deposit.covers(grid.reshape(-1, 3)).reshape(len(steps), -1)
    lumen = ink if of_ink else ndimage.binary_opening(~ink, ndimage.iterate_structure(CROSS, 2))
    labels, _ = ndimage.label(lumen)
    near = np.hypot(*np.meshgrid(steps, steps, indexing="ij")) <= 0.5 * radius
    inside = labels[near]
    inside = inside[inside > 0]
    if not len(inside):
        return 0.0
    own = labels == np.bincount(inside).argmax()
    if own[0].any() or own[-1].any() or own[:, 0].any() or own[:, -1].any():
        return None
    return float(2 * np.sqrt(own.sum() * PIXEL_MM**2 / np.pi))


CROSS = ndimage.generate_binary_structure(2, 1)


TAPER_STEPS = 40


def drawn(vessels: list[Vessel]) -> Deposit:
    """Return the designed lumens: round pieces with round ends, a taper in short steps."""
    tables = []
    for vessel in vessels:
        places = np.unique(np.concatenate([
            np.linspace(a, b, TAPER_STEPS + 1 if first != second else 2)
            for (a, b), (first, second) in zip(
                pairwise(vessel.along), pairwise(vessel.radius), strict=True
            )
        ]))  # fmt: skip
        points = np.array([np.interp(places, vessel.along, axis) for axis in vessel.points.T]).T
        radius = np.interp((places[:-1] + places[1:]) / 2, vessel.along, vessel.radius)
        tables.append(np.column_stack([points[:-1], points[1:], radius]))
    table = np.concatenate(tables)
    return capsules(table[:, :3], table[:, 3:6], table[:, 6])


def local_diameter(deposit: Deposit, vessel: Vessel, along: float, of_ink: bool) -> float | None:
    """Return the mean of four sections over a twentieth of a millimetre, mm."""
    places = np.clip(along + np.linspace(-0.03, 0.03, 4), 1e-6, vessel.along[-1] - 1e-6)
    found = [section(deposit, vessel, float(one), of_ink) for one in places]
    return None if any(one is None for one in found) else float(np.mean(found))  # type: ignore[arg-type]


def measure(deposit: Deposit, vessels: list[Vessel], part: trimesh.Trimesh, of_ink: bool) -> Truth:
    """Return the truth about all vessels of a print."""
    truth, walls, design = Truth(), Walls(part), drawn(vessels)
    widest = _widest_at_nodes(vessels)
    for vessel in vessels:
        length = vessel.along[-1]
        own: list[tuple[float, float]] = []
        narrowest = np.inf
        for along in np.arange(SPACING_MM / 2, length, SPACING_MM):
            found = section(deposit, vessel, float(along), of_ink)
            if found is None:
                continue
            narrowest = min(narrowest, found)
            place, _, radius = vessel.at(float(along))
            ends = (along, length - along)
            if (
                any(
                    end < 1.6 * widest[node] + 0.1
                    for end, node in zip(ends, vessel.nodes, strict=True)
                )
                or walls.depth(place) < 1.8 * radius
            ):
                continue
            # At a kink the designed lumen itself is wider than its vessels.
            designed = section(design, vessel, float(along), of_ink=True)
            if designed:
                own.append((found, designed))
        if own:
            table = np.array(own)
            truth.mean_um[vessel.number] = 1000 * float(table[:, 0].mean())
            errors = 100 * (_smooth(table[:, 0]) / _smooth(table[:, 1]) - 1)
            truth.worst_percent[vessel.number] = float(errors[np.abs(errors).argmax()])
        if np.isfinite(narrowest):
            truth.narrowest_um[vessel.number] = 1000 * narrowest
            truth.open[vessel.number] = bool(narrowest > OPEN_SHARE * 2 * vessel.radius.min())
    low, high = deposit.bounds
    truth.size_mm = tuple(round(float(one), 4) for one in high - low)  # type: ignore[assignment]
    truth.leaks, truth.bridges = _ways(deposit, vessels, part, of_ink)
    return truth


def _smooth(values: Array) -> Array:
    """Return means over three neighbouring sections: a single one may fall between two lines."""
    return np.asarray(ndimage.uniform_filter1d(values, 3, mode="nearest"))


def _widest_at_nodes(vessels: list[Vessel]) -> dict[int, float]:
    widest: dict[int, float] = {}
    for vessel in vessels:
        for node, radius in zip(vessel.nodes, (vessel.radius[0], vessel.radius[-1]), strict=True):
            widest[node] = max(widest.get(node, 0.0), float(radius))
    return widest


def _groups(vessels: list[Vessel]) -> dict[int, int]:
    """Return for each vessel the connected network that it belongs to."""
    root = {node: node for vessel in vessels for node in vessel.nodes}

    def top(node: int) -> int:
        while root[node] != node:
            node = root[node]
        return node

    for vessel in vessels:
        root[top(vessel.nodes[0])] = top(vessel.nodes[1])
    names = {one: k for k, one in enumerate(sorted({top(node) for node in root}))}
    return {vessel.number: names[top(vessel.nodes[0])] for vessel in vessels}


def _ways(
    deposit: Deposit, vessels: list[Vessel], part: trimesh.Trimesh, of_ink: bool
) -> tuple[list[int], list[tuple[int, int]]]:
    """Return leaking networks and bridged pairs, by flooding what is free (or written)."""
    low = np.minimum(deposit.bounds[0], part.bounds[0]) - 5 * GRID_MM
    high = np.maximum(deposit.bounds[1], part.bounds[1]) + 5 * GRID_MM
    step = GRID_MM if not of_ink else max(GRID_MM, (np.prod(high - low) / MAX_CELLS) ** (1 / 3))
    shape = np.ceil((high - low) / step).astype(int)
    open_to_flow = np.zeros(shape, bool)
    x, y = (low[a] + step * np.arange(shape[a]) for a in (0, 1))
    plane = np.stack([*np.meshgrid(x, y, indexing="ij"), np.zeros(shape[:2])], axis=-1)
    for k in range(shape[2]):
        plane[..., 2] = low[2] + k * step
        ink = deposit.covers(plane.reshape(-1, 3), 0.0 if of_ink else LEAK_MM / 2)
        open_to_flow[..., k] = (ink if of_ink else ~ink).reshape(shape[:2])
    for place, radius in _mouths(vessels, part):
        _clear_ball(open_to_flow, (place - low) / step, radius / step)
    labels, _ = ndimage.label(open_to_flow)
    outside = 0 if of_ink else int(labels[0, 0, 0])
    groups = _groups(vessels)
    seen: dict[int, set[int]] = {}
    for vessel in vessels:
        for along in np.arange(0.05, vessel.along[-1], 0.1):
            cell = np.round((vessel.at(float(along))[0] - low) / step).astype(int)
            if (cell >= 0).all() and (cell < shape).all():
                seen.setdefault(groups[vessel.number], set()).add(int(labels[tuple(cell)]))
    leaks = sorted(group for group, found in seen.items() if outside and outside in found)
    bridges = [
        (a, b)
        for a in sorted(seen)
        for b in sorted(seen)
        if a < b and (seen[a] & seen[b]) - {0, outside}
    ]
    return leaks, bridges


def _mouths(vessels: list[Vessel], part: trimesh.Trimesh) -> list[tuple[Array, float]]:
    """Return where free ends pass the part's surface, with the radius of a plug."""
    nodes = [node for vessel in vessels for node in vessel.nodes]
    walls, mouths = Walls(part, 1000), []
    for vessel in vessels:
        for node, points, radius in (
            (vessel.nodes[0], vessel.points, float(vessel.radius[0])),
            (vessel.nodes[1], vessel.points[::-1], float(vessel.radius[-1])),
        ):
            if nodes.count(node) > 1:
                continue
            mouths.append((_mouth(walls, part, points, radius), 1.7 * radius + 0.12))
    return mouths


def _mouth(walls: Walls, part: trimesh.Trimesh, points: Array, radius: float) -> Array:
    """Return where a vessel whose free end is its first point passes the surface; else its end."""
    for outer, inner in pairwise(points):
        middle = inner if len(points) > 2 else (inner + outer) / 2
        if not walls.inside(middle):
            continue
        way = (outer - middle) / np.linalg.norm(outer - middle)
        lengths, _ = hits(part, middle, way)
        if len(lengths) and np.linalg.norm(middle + lengths[0] * way - points[0]) < 3 * radius + 1:
            return np.asarray(middle + lengths[0] * way)
        break
    return np.asarray(points[0])


def _clear_ball(grid: NDArray[np.bool_], middle: Array, radius: float) -> None:
    first = np.maximum(np.floor(middle - radius).astype(int), 0)
    last = np.minimum(np.ceil(middle + radius).astype(int) + 1, grid.shape)
    box = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    index = np.stack(
        np.meshgrid(*(np.arange(a, b) for a, b in zip(first, last, strict=True)), indexing="ij"), -1
    )
    grid[box] &= np.linalg.norm(index - middle, axis=-1) > radius


def shrunk(truth_mm: float, shrink_percent: float) -> float:
    """Return a length of the scanned part: it shrank after printing."""
    return truth_mm * (1 - shrink_percent / 100)


def as_json(truth: Truth) -> dict[str, Any]:
    """Return the truth for a case's line of JSON."""
    return {
        "mean_um": {k: round(v, 1) for k, v in truth.mean_um.items()},
        "worst_percent": {k: round(v, 1) for k, v in truth.worst_percent.items()},
        "closed": [k for k, v in truth.open.items() if not v],
        "leaks": truth.leaks,
        "bridges": truth.bridges,
        "size_mm": truth.size_mm,
    }
