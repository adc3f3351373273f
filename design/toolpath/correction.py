"""Correct a design's geometry by deviations of earlier prints: scale, lumens, positions.

Goes in: a design and corrections. Comes out: the corrected design.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.errors import ToolpathError
from design.geometry.polyline import arc_lengths
from design.network import VesselNetwork
from design.solids.solid import Solid
from design.vasculature.collide import check_network, collisions
from kernels.arrays import FloatArray


class _CorrectionLimits(NamedTuple):
    """Most that is corrected; more is a fault to be mended."""

    stretch: float = 0.10  # more isn't shrinkage, but a wrong unit or a wrong scan
    diameter: float = 0.20  # of a lumen's diameter, or
    diameter_mm: float = 0.150  # so much of it, if that is less
    offset_mm: float = 0.150  # of a node
    slack_mm: float = 1e-3  # walls thinner by no more than this are as they were


LIMITS: Final = _CorrectionLimits()


@dataclass(frozen=True)
class Stretch:
    """The map p → about + factor · (p - about), axis by axis.

    Attributes
    ----------
    factor : (x, y, z) float
        Written over designed length.
    about_mm : (x, y, z) float, mm
        What stays where it is, part frame: the part's middle, at the height of its foot.
    """

    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    about_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def is_neutral(self) -> bool:
        """Whether it changes nothing."""
        return self.factor == (1.0, 1.0, 1.0)

    @property
    def matrix(self) -> FloatArray:
        """The map as (4, 4) homogeneous matrix, designed to written."""
        out = np.diag([*self.factor, 1.0])
        out[:3, 3] = np.array(self.about_mm) * (1 - np.array(self.factor))
        return out

    def points(self, points: FloatArray) -> FloatArray:
        """Designed places (n, 3) to written ones; exactly the same ones when neutral."""
        if self.is_neutral:
            return points
        about = np.array(self.about_mm)
        return np.asarray(about + np.array(self.factor) * (points - about))

    def back(self, points: FloatArray) -> FloatArray:
        """Written places (n, 3) to designed ones."""
        if self.is_neutral:
            return points
        about = np.array(self.about_mm)
        return np.asarray(about + (points - about) / np.array(self.factor))

    def solid(self, solid: Solid) -> Solid:
        """The solid as it is written; float32 as every solid."""
        if self.is_neutral:
            return solid
        vertices = self.points(solid.vertices).astype(np.float32).astype(np.float64)
        return Solid(vertices, solid.faces)

    def network(self, network: VesselNetwork) -> VesselNetwork:
        """The network as it is written: places moved, radii so that the volume follows."""
        if self.is_neutral:
            return network
        widths = np.concatenate(
            [self.across(way) for way in map(_ways, (p for p, _ in network.polylines()))]
        )
        return replace(
            network,
            nodes=self.points(network.nodes),
            points=self.points(network.points),
            radius=network.radius * widths,
        )

    def across(self, along: FloatArray) -> FloatArray:
        """Factor of a round lumen's equal-area radius, (n,), whose axis runs `along` (n, 3), unit.

        The volume grows by the product of the factors and the length by that along the axis; what
        is left is the area's.
        """
        factor = np.array(self.factor)
        longer = np.linalg.norm(along * factor, axis=1)
        return np.asarray(np.sqrt(np.prod(factor) / longer))


@dataclass(frozen=True)
class Corrections:
    """What is written instead of the design.

    Local corrections come first, in the design's own frame; the stretch is laid over the result.

    Attributes
    ----------
    stretch : Stretch
        Of the part as a whole.
    radial_mm, radial_slope : float, mm and mm/mm
        Added to every lumen's radius: ``radial_mm + radial_slope · (d - radial_at_mm)`` of its
        designed diameter d, which counts within `radial_range_mm` only.
    radial_at_mm : float, mm
    radial_range_mm : (least, most), mm
    diameter_mm : mapping of int to float, mm
        Added to the diameters of single vessels.
    offset_mm : mapping of int to (x, y, z), mm
        By which single nodes move; vessels between follow linearly along their length.
    """

    stretch: Stretch = field(default_factory=Stretch)
    radial_mm: float = 0.0
    radial_slope: float = 0.0
    radial_at_mm: float = 0.0
    radial_range_mm: tuple[float, float] = (0.0, float("inf"))
    diameter_mm: dict[int, float] = field(default_factory=dict)
    offset_mm: dict[int, tuple[float, float, float]] = field(default_factory=dict)

    @property
    def changes_lumens(self) -> bool:
        """Whether lumens differ from the design's before the stretch."""
        radial = bool(self.radial_mm or self.radial_slope)
        return radial or any(self.diameter_mm.values()) or any(map(any, self.offset_mm.values()))

    def radial(self, diameter_mm: FloatArray) -> FloatArray:
        """What is added to the radii of lumens of designed diameters (n,), mm."""
        within = np.clip(diameter_mm, *self.radial_range_mm)
        return np.asarray(self.radial_mm + self.radial_slope * (within - self.radial_at_mm))

    def radius_change(self, network: VesselNetwork) -> FloatArray:
        """What is added to each point's radius, (p,), mm."""
        own = np.zeros(network.vessel_count)
        for vessel, change in self.diameter_mm.items():
            own[vessel] = change / 2
        return self.radial(2 * network.radius) + np.repeat(own, np.diff(network.offset))

    def locally(self, network: VesselNetwork) -> VesselNetwork:
        """The network with its lumens corrected, in the design's frame and size.

        Raises
        ------
        ToolpathError
            When a change is beyond its limit, or of a vessel or node that isn't there.
        """
        self.check(network)
        if not self.changes_lumens:
            return network
        moved = self.node_offsets(network)
        shift = np.concatenate([_shifts(network, moved, v) for v in range(network.vessel_count)])
        return replace(
            network,
            nodes=network.nodes + moved,
            points=network.points + shift,
            radius=network.radius + self.radius_change(network),
        )

    def written(self, network: VesselNetwork) -> VesselNetwork:
        """The network as it is to be written.

        Raises
        ------
        ToolpathError
            As `locally`.
        """
        return self.stretch.network(self.locally(network))

    def node_offsets(self, network: VesselNetwork) -> FloatArray:
        """By how much each node moves, (m, 3), mm."""
        moved = np.zeros_like(network.nodes)
        for node, offset in self.offset_mm.items():
            moved[node] = offset
        return moved

    def check(self, network: VesselNetwork) -> None:
        """Refuse what is out of bounds.

        Raises
        ------
        ToolpathError
            With the vessel or node, its change, the limit and the remedy.
        """
        _check_stretch(self.stretch)
        _check_numbers(self, network)
        change, limit = 2 * self.radius_change(network), _limits(2 * network.radius)
        worst = int(np.argmax(np.abs(change) / limit))
        if abs(change[worst]) > limit[worst] * (1 + 1e-9):
            vessel = int(np.searchsorted(network.offset, worst, side="right")) - 1
            raise ToolpathError(
                f"vessel {vessel}: its diameter of {2e3 * network.radius[worst]:.0f} um would be "
                f"changed by {1e3 * change[worst]:+.0f} um, limit {1e3 * limit[worst]:.0f} um "
                f"({100 * LIMITS.diameter:g} % or {1e3 * LIMITS.diameter_mm:g} um, compensation); "
                "so much is a fault to be mended (flow calibration, needle, a defect), not "
                "corrected"
            )
        for node, offset in self.offset_mm.items():
            away = float(np.linalg.norm(offset))
            if not away <= LIMITS.offset_mm:
                raise ToolpathError(
                    f"node {node}: it would be moved by {1e3 * away:.0f} um, limit "
                    f"{1e3 * LIMITS.offset_mm:g} um (compensation); so much is a fault to be "
                    "mended (backlash, a bent needle, a wrong pose), not corrected"
                )


def _limits(diameter_mm: FloatArray) -> FloatArray:
    return np.minimum(LIMITS.diameter * diameter_mm, LIMITS.diameter_mm)


def _check_stretch(stretch: Stretch) -> None:
    for axis, factor in zip("xyz", stretch.factor, strict=True):
        if not abs(factor - 1) <= LIMITS.stretch * (1 + 1e-9):
            raise ToolpathError(
                f"the part would be written {factor:.3f} times as long along {axis}, limit "
                f"{1 - LIMITS.stretch:g} to {1 + LIMITS.stretch:g} (compensation); check the "
                "scan's voxel size and the printer's steps per mm first"
            )


def _check_numbers(corrections: Corrections, network: VesselNetwork) -> None:
    for what, numbers, count in (
        ("vessel", corrections.diameter_mm, network.vessel_count),
        ("node", corrections.offset_mm, len(network.nodes)),
    ):
        wrong = [number for number in numbers if not 0 <= number < count]
        if wrong:
            raise ToolpathError(
                f"{what} {wrong[0]} (compensation) isn't in the network, which has {count}; the "
                "compensation belongs to another design"
            )


def _shifts(network: VesselNetwork, moved: FloatArray, vessel: int) -> FloatArray:
    """By how much each point of a vessel moves, (k, 3): linear along it between its nodes."""
    points, _ = network.polyline(vessel)
    path = arc_lengths(points)
    share = (path / max(float(path[-1]), 1e-12))[:, None]
    first, last = network.vessel_nodes[vessel]
    return np.asarray((1 - share) * moved[first] + share * moved[last])


def _ways(points: FloatArray) -> FloatArray:
    """Unit direction at each point of a polyline: along the chord between its neighbours."""
    ahead = np.vstack([points[1:], points[-1:]])
    behind = np.vstack([points[:1], points[:-1]])
    way = ahead - behind
    length = np.linalg.norm(way, axis=1, keepdims=True)
    return np.asarray(way / np.maximum(length, 1e-12))


NEUTRAL = Corrections()
"""Changes nothing."""


# A design may be tighter somewhere than the method likes: it was accepted as it is. Refused is what
# a correction makes too thin.
_PLACES: Final = 8
"""At which each straight piece's distance to the outside is measured."""


class Body(Protocol):
    """What the vessels lie in."""

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance of places (n, 3) to its surface, (n,), mm; negative inside."""


def check_walls(before: VesselNetwork, after: VesselNetwork, wall_mm: float) -> None:
    """Refuse vessels that touch, or whose wall became thinner than ``wall_mm``.

    Raises
    ------
    NetworkError
        When vessels overlap that didn't.
    ToolpathError
        With the two vessels, the wall and the limit.
    """
    was, now = collisions(before, wall_mm), collisions(after, wall_mm)
    if not was.count or float(was.gap_mm.min()) >= 0:
        check_network(after)
    had = {(int(a), int(b)): float(g) for (a, b), g in zip(was.pieces, was.gap_mm, strict=True)}
    pieces = zip(now.pieces.tolist(), now.vessels.tolist(), now.gap_mm.tolist(), strict=True)
    for (a, b), (one, two), gap in pieces:
        if gap < min(had.get((a, b), wall_mm), wall_mm) - LIMITS.slack_mm:
            raise ToolpathError(
                f"vessels {one} and {two}: the compensation would leave {1e3 * gap:.0f} um of wall "
                f"between them, limit {1e3 * wall_mm:.0f} um (a line, or the needle's room); leave "
                "one of them out (compensate --without-vessel) or move them apart in the design"
            )


def check_outside(before: VesselNetwork, after: VesselNetwork, body: Body, wall_mm: float) -> None:
    """Refuse lumens that came nearer to the body's surface than ``wall_mm``.

    Places that were nearer by design may stay as near as they were; around free ends, where
    lumens open through the surface, nothing is asked.

    Raises
    ------
    ToolpathError
        With the vessel, the wall and the limit.
    """
    had, has = _depths(before, body), _depths(after, body)
    asked = ~_at_ends(before, wall_mm) & (had > 0)
    thin = np.flatnonzero(asked & (has < np.minimum(had, wall_mm) - LIMITS.slack_mm))
    if len(thin) == 0:
        return
    worst = int(thin[np.argmin(has[thin])])
    vessel = int(before.pieces()[4][worst // _PLACES])
    raise ToolpathError(
        f"vessel {vessel}: the compensation would leave {1e3 * has[worst]:.0f} um between it and "
        f"the outside, limit {1e3 * wall_mm:.0f} um (it has {1e3 * had[worst]:.0f} by design); "
        f"leave it out (compensate --without-vessel {vessel}) or make the body larger"
    )


def _places(network: VesselNetwork) -> tuple[FloatArray, FloatArray]:
    """Places along every piece (n, 3), and the radii there (n,), mm."""
    start, end, r0, r1, _ = network.pieces()
    share = ((np.arange(_PLACES) + 0.5) / _PLACES)[None, :]
    places = start[:, None] * (1 - share[..., None]) + end[:, None] * share[..., None]
    radius = r0[:, None] * (1 - share) + r1[:, None] * share
    return places.reshape(-1, 3), radius.reshape(-1)


def _depths(network: VesselNetwork, body: Body) -> FloatArray:
    """Wall to the body's surface at places along every piece, (n,), mm."""
    places, radius = _places(network)
    return np.asarray(-body.distance(places) - radius)


def _at_ends(network: VesselNetwork, wall_mm: float) -> NDArray[np.bool_]:
    """Whether the surface near each place may be the one that a free end opens."""
    ends = network.nodes[network.degree() == 1]
    places, radius = _places(network)
    if len(ends) == 0:
        return np.zeros(len(places), dtype=np.bool_)
    away, _ = cKDTree(ends).query(places)
    return np.asarray(away < 1.5 * (radius + wall_mm))
