"""Test designs: a body with straight, curved, branching and tapering vessels."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.scans.bodies import Body, block, cylinder, wedge

PIECE_MM = 0.25


@dataclass(frozen=True)
class Vessel:
    """A polyline with a radius at each point; it runs from node to node.

    Attributes
    ----------
    nodes : (int, int)
        Numbers of the nodes at its start and end.
    points : (n, 3) float, mm
    radius : (n,) float, mm
    """

    nodes: tuple[int, int]
    points: np.ndarray
    radius: np.ndarray

    @property
    def along(self) -> np.ndarray:
        """Length from the start to each point, mm."""
        return np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))]
        )

    def at(self, along: np.ndarray | float) -> np.ndarray:
        """Return points at lengths along it, mm; shape (..., 3)."""
        return np.stack([np.interp(along, self.along, c) for c in self.points.T], axis=-1)

    def radius_at(self, along: np.ndarray | float) -> np.ndarray:
        """Return designed radii at lengths along it, mm."""
        return np.asarray(np.interp(along, self.along, self.radius))


@dataclass
class Design:
    """A body and its vessels; part frame, mm."""

    body: Body
    nodes: list[tuple[float, float, float]] = field(default_factory=list)
    vessels: list[Vessel] = field(default_factory=list)

    def node(self, x: float, y: float, z: float) -> int:
        """Add a node; return its number."""
        self.nodes.append((float(x), float(y), float(z)))
        return len(self.nodes) - 1

    def add(
        self, a: int, b: int, diameters: tuple[float, ...], bend: tuple[float, ...] = ()
    ) -> None:
        """Add a vessel between two nodes.

        Diameters (mm) are spread evenly along it. `bend` (x, y, z, mm) moves the middle of a
        spline aside; without it the vessel is straight.
        """
        ends = np.array([self.nodes[a], self.nodes[b]])
        points = curve(ends, np.array(bend)) if bend else ends
        if len(diameters) > 1 and not bend:
            points = np.linspace(ends[0], ends[1], 9)
        share = np.linspace(0, 1, len(points))
        radius = np.interp(
            share,
            np.linspace(0, 1, max(len(diameters), 2)),
            np.resize(diameters, max(len(diameters), 2)),
        )
        self.vessels.append(Vessel((a, b), points, radius / 2))

    def open_ends(self, vessel: int) -> tuple[bool, bool]:
        """Whether a vessel's start and end lie on the body's surface."""
        ends = self.vessels[vessel].points[[0, -1]]
        first, last = np.abs(self.body.depth(ends)) < 1e-6
        return bool(first), bool(last)


def curve(ends: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """Return points of an S-shaped spline through two ends, its middle moved by `bend`."""
    share = np.array([0, 0.25, 0.5, 0.75, 1])
    knots = ends[0] + share[:, None] * (ends[1] - ends[0])
    knots += np.outer([0, 0.9, 1, 0.35, 0], bend)
    pieces = max(4, int(np.linalg.norm(ends[1] - ends[0]) / PIECE_MM))
    return np.asarray(CubicSpline(share, knots)(np.linspace(0, 1, pieces + 1)))


def curved() -> Design:
    """Return a block with a curved branching tree and a tapering channel, seven vessels."""
    d = Design(block(10, 8, 2.8))
    n = [
        d.node(*p)
        for p in (
            (0, 3.2, 1.3),
            (3, 3.6, 1.4),
            (6, 2.4, 1.6),
            (5.8, 5.2, 1.2),
            (10, 1.2, 1.5),
            (10, 3.4, 1.3),
            (10, 4.9, 1.5),
            (7.6, 8, 1.2),
            (0, 6.3, 1.6),
            (4.6, 6.9, 1.3),
        )
    ]
    d.add(n[0], n[1], (0.9, 0.8), (0, 0.35, 0.1))
    d.add(n[1], n[2], (0.7,), (0.1, -0.3, 0))
    d.add(n[1], n[3], (0.66,), (-0.2, 0.2, 0))
    d.add(n[2], n[4], (0.55, 0.45), (0, -0.3, 0.15))
    d.add(n[2], n[5], (0.5,), (0, 0.25, 0))
    d.add(n[3], n[6], (0.52, 0.42), (0, 0.3, -0.1))
    d.add(n[3], n[7], (0.44,), (0.2, 0.1, 0))
    d.add(n[8], n[9], (0.6, 0.35))
    return d


def fifteen() -> Design:
    """Return a block with fifteen channels of 0.3 to 1 mm, straight and bent, none joined."""
    d = Design(block(12, 15, 3.0))
    widths = np.linspace(0.3, 1.0, 15)[[0, 7, 14, 3, 10, 1, 8, 13, 4, 11, 2, 9, 12, 5, 6]]
    for k, width in enumerate(widths):
        y = 0.85 + 0.95 * k
        a, b = d.node(0, y, 1.3 + 0.25 * (k % 3)), d.node(12, y, 1.3 + 0.2 * ((k + 1) % 3))
        d.add(a, b, (float(width),), (0, 0.12 * (-1) ** k, 0.1) if k % 2 else ())
    return d


def slanted() -> Design:
    """Return a wedge with a chamfer and five vessels, one bent."""
    d = Design(wedge(9, 7.5, 2.9))
    n = [
        d.node(*p)
        for p in (
            (0, 1.4, 1.2),
            (9, 1.9, 1.0),
            (0, 3.6, 1.6),
            (4.2, 3.4, 1.2),
            (9, 4.6, 0.9),
            (0, 5.9, 1.4),
            (6.2, 7.5, 1.2),
        )
    ]
    d.add(n[0], n[1], (0.45,), (0, 0.1, 0.2))
    d.add(n[2], n[3], (0.7,))
    d.add(n[3], n[4], (0.55, 0.4))
    d.add(n[5], n[6], (0.5,), (0.3, -0.4, 0))
    return d


def compact() -> Design:
    """Return a small chunky block that can lie on any face, four vessels."""
    d = Design(block(4.6, 4.0, 3.4))
    n = [
        d.node(*p)
        for p in (
            (0, 1.1, 1.1),
            (2.1, 1.6, 1.5),
            (4.6, 1.0, 2.3),
            (2.6, 4.0, 1.9),
            (0, 2.9, 2.3),
            (1.6, 2.9, 3.4),
        )
    ]
    d.add(n[0], n[1], (0.6,))
    d.add(n[1], n[2], (0.45,), (0, -0.2, 0.1))
    d.add(n[1], n[3], (0.4,))
    d.add(n[4], n[5], (0.36,), (0.3, 0, -0.3))
    return d


def rim(degrees: float, z: float) -> tuple[float, float, float]:
    """Return a point on the drum's side, mm."""
    angle = np.radians(degrees)
    return (float(3.75 + 3.75 * np.cos(angle)), float(3.75 + 3.75 * np.sin(angle)), z)


def drum() -> Design:
    """Return a cylinder with a branching and a bent channel."""
    d = Design(cylinder(7.5, 2.8))
    n = [
        d.node(*p)
        for p in (
            rim(180, 1.3),
            (3.2, 3.5, 1.4),
            rim(20, 1.6),
            rim(-50, 1.2),
            rim(130, 1.5),
            rim(70, 1.1),
        )
    ]
    d.add(n[0], n[1], (0.8, 0.7))
    d.add(n[1], n[2], (0.5,), (0, 0.3, 0))
    d.add(n[1], n[3], (0.6,))
    d.add(n[4], n[5], (0.4,), (0, -0.5, 0.2))
    return d


def half_turns() -> Design:
    """Return a block that half turns about x, y and z, and mirrors, leave as it is."""
    d = Design(block(9, 8, 2.6))
    for y in (2.5, 5.5):
        d.add(d.node(0, y, 1.3), d.node(9, y, 1.3), (0.6,))
    return d


def quarter_turns() -> Design:
    """Return a cylinder with a cross of four equal channels, unchanged by quarter turns about z."""
    d = Design(cylinder(7.5, 2.6))
    middle = d.node(3.75, 3.75, 1.1)
    for x, y in ((7.5, 3.75), (3.75, 7.5), (0, 3.75), (3.75, 0)):
        d.add(d.node(x, y, 1.1), middle, (0.55,))
    return d


def mirrored_pair() -> Design:
    """Return a block that a mirror (y) leaves as it is, and no turn."""
    d = Design(block(9, 8, 2.6))
    fork = d.node(3.2, 4, 1.1)
    d.add(d.node(0, 4, 1.1), fork, (0.8,))
    for y in (2.0, 6.0):
        d.add(fork, d.node(9, y, 1.4), (0.5, 0.4))
    return d


DESIGNS = {
    f.__name__: f
    for f in (curved, fifteen, slanted, compact, drum, half_turns, quarter_turns, mirrored_pair)
}
