"""Find the lumens of a solid without its network: centre lines and radii, from the mesh alone.

Voxels decide what hangs together (`centre_lines`); axes and radii are those of the mesh's own
sections across it, by rays. What no vessel's tube covers, and vessels far from round, are unsure.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from manifold3d import Manifold
from scipy import ndimage
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from design.errors import SolidError
from design.geometry.mesh import connected_parts
from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselKind, VesselNetwork
from design.solids.axes.centre_lines import (
    ALL_NEIGHBOURS,
    CentreLine,
    Hollow,
    centre_lines,
    hollow_voxels,
    joined,
    paint_ball,
)
from design.solids.manifolds import solid_manifold
from design.solids.solid import Solid
from design.solids.topology import construct_genus
from design.vasculature.growth.trunk import straighten_line
from kernels.arrays import BoolArray, FloatArray, IntArray


class VoxelLimits(NamedTuple):
    """Resolution of the voxels in which lumens are searched."""

    # Of the box around the solid, first and where lumens are too thin for that.
    max_voxels: tuple[int, int] = (4_000_000, 40_000_000)
    finest_mm: float = 0.02  # Pitch
    min_radius: float = 3.0  # voxels: of the thinnest lumen that is resolved
    min_part_mm: float = 1.0  # A smaller part without lumens was probably exported in another unit


class SectionLimits(NamedTuple):
    """How axes are laid along a lumen's sections, and when they are sure; lengths in radii."""

    rays: int = 40  # Across a section
    rounds: int = 4  # Of sections across the line through the middles of the last ones
    reach: float = 6.0  # Of a ray
    max_aspect: float = 2.0  # Length over width of a round lumen's section
    # Relative difference of sections next to each other outside of joints and bends, at most.
    even: float = 0.015
    # A section so many times as wide as the median of its vessel belongs to a joint.
    wider: float = 1.3
    steepest: float = 0.3  # Change of a radius over its way; where it is more, its place isn't sure
    # Of a joint from where its lumens part: farther, its vessels aren't straight.
    max_move: float = 8.0
    straight_mm: float = 0.003  # Greatest distance of a line's points from the axis that is kept
    aside: float = 0.3  # A lumen's wall may lie by so much beside its vessel's, or two voxels
    # Share of connected lumens' volume that no vessel follows; above, none of their axes is
    # sure.
    max_left: float = 0.1
    # Radius of a ball as large as the least piece of lumens that counts as not followed.
    min_left: float = 0.5


VOXELS: Final = VoxelLimits()
SECTIONS: Final = SectionLimits()


@dataclass(frozen=True)
class FoundLumens:
    """Lumens of a part as a network of channels, and where that may not be what the part has.

    Attributes
    ----------
    network : VesselNetwork
    left : float
        Share of the lumens' volume that lies in pieces that no vessel follows.
    left_at : (n, 3), mm
        A place in each of these, the largest first.
    stretches : tuple of tuples of (from, to), mm
        Of each vessel, where it isn't sure to lie in the middle of its lumen, or to be one.
    """

    network: VesselNetwork
    left: float
    left_at: FloatArray
    stretches: tuple[tuple[tuple[float, float], ...], ...]


def found_lumens(solid: Solid, *, is_lumen: bool = False) -> FoundLumens:
    """Find the lumens of a part, and what is unsure of them.

    Parameters
    ----------
    solid : Solid
        The part; or, with `is_lumen`, its lumens as a body.

    Raises
    ------
    SolidError
        When there is none that is at least as long as it is wide.
    """
    body = solid_manifold(solid, "the model")
    extent = np.ptp(solid.vertices, axis=0)
    for most in VOXELS.max_voxels:
        pitch = max(VOXELS.finest_mm, float((np.prod(extent) / most) ** (1 / 3)))
        hollow = hollow_voxels(body, pitch, is_lumen=is_lumen)
        lines = centre_lines(hollow)
        thin = min((float(np.median(line.radius)) for line in lines), default=0.0)
        is_fine = thin >= VOXELS.min_radius * pitch and all(line.is_sure for line in lines)
        if is_fine or pitch == VOXELS.finest_mm:
            break
    if not lines and extent.max() < VOXELS.min_part_mm:
        size = " × ".join(f"{one:.3g}" for one in extent)
        raise SolidError(
            f"no lumen was found in the model: it is only {size} mm in all, and lumens are looked "
            f"for from {2 * VOXELS.finest_mm:g} mm on; if it was exported in metres or inches, "
            "give its unit"
        )
    if not lines:
        raise SolidError(
            "no lumen was found in the model: no hollow that it shuts in is longer than wide; give "
            "the network of its vessels, or the STL of the whole part with its channels cut out"
        )
    rays = _Rays(body, -1 if is_lumen else 1)
    lines = _measured(lines, pitch, rays)
    if len(one_joint := joined(lines)) < len(lines):
        lines = _measured(one_joint, pitch, rays)
    return _checked(_network(lines), [line.is_sure for line in lines], hollow)


def unfollowed_ways(solid: Solid, network: VesselNetwork) -> int:
    """Return how many ways through a part its surface has beyond those that a network follows."""
    ends = np.flatnonzero(network.degree() == 1)
    return max(0, solid_manifold(solid, "the model").genus() - construct_genus(network, ends))


@dataclass(frozen=True, eq=False)
class _Rays:
    """Rays through a hollow to its walls; `turn`: 1 where lumens are holes in the body, -1 bodies.

    A wall faces its lumen: its normal, out of the body, points against a ray, or with it.
    """

    body: Manifold
    turn: int

    def section(self, place: FloatArray, way: FloatArray, reach: float) -> FloatArray | None:
        """Return centre (3), radius of equal area and length over width of the section, (5,)."""
        u, v = _across(way)
        turn = np.arange(SECTIONS.rays) * 2 * np.pi / SECTIONS.rays
        ray = np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v
        wall = np.array([self._ahead(place, one, reach) for one in ray])
        if not np.isfinite(wall).all():
            return None
        square = float((wall**2).mean())
        off = (wall[:, None] ** 3 * ray).mean(axis=0) * 2 / 3 / square
        width = wall + np.roll(wall, SECTIONS.rays // 2)
        return np.array([*(place + off), np.sqrt(square), width.max() / width.min()])

    def to_end(self, place: FloatArray, way: FloatArray, radius: float) -> float:
        """How far ahead the wall of a blind end is, or the face that the lumen opens through."""
        reach = SECTIONS.reach * radius
        blind = self._ahead(place, way, reach)
        if self.turn < 0:
            return blind
        u, v = _across(way)
        turn = np.arange(8) * np.pi / 4
        beside = place + 1.1 * radius * (np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v)
        # From in the solid beside even a slanted mouth.
        back = 2 * radius * way
        away = np.array([self._ahead(one - back, way, 2 * reach, -1) for one in beside])
        return min(blind, float(np.median((away[:4] + away[4:]) / 2)) - 2 * radius)

    def _ahead(self, start: FloatArray, way: FloatArray, reach: float, side: int = 1) -> float:
        """How far ahead a wall is: inf where none is within reach, or it faces away."""
        hits = self.body.ray_cast(start.tolist(), (start + reach * way).tolist())
        if not hits or float(np.dot(hits[0].normal, way)) * self.turn * side > 0:
            return np.inf
        return float(hits[0].distance) * reach


def _across(way: FloatArray) -> tuple[FloatArray, FloatArray]:
    u = np.cross(way, np.eye(3)[np.abs(way).argmin()])
    u /= np.linalg.norm(u)
    return u, np.cross(way, u)


def _measured(lines: list[CentreLine], pitch: float, rays: _Rays) -> list[CentreLine]:
    """Lay vessels along the middles of their sections, from joint to joint or to their ends."""
    ends = np.array([line.ends for line in lines])
    degree = np.bincount(ends.ravel())
    first, wide = np.zeros((len(degree), 3)), np.zeros(len(degree))
    np.add.at(first, ends, np.array([line.line[[0, -1]] for line in lines]))
    np.maximum.at(wide, ends, np.array([line.radius[[0, -1]] for line in lines]))
    first /= np.maximum(degree, 1)[:, None]
    # A ring's own node is no joint.
    nodes, wide = first.copy(), np.where(degree > 2, wide, 1e-9 * (degree == 2))
    lines = [
        replace(one, line=gaussian_filter1d(one.line, np.median(one.radius) / pitch, axis=0))
        for one in lines
    ]
    for _ in range(SECTIONS.rounds):
        lines = [_sections(_whole(line, nodes, degree), wide, rays) for line in lines]
        for node in np.flatnonzero(degree > 1):
            ways = list(_ways_into(int(node), lines))
            if degree[node] == 2:
                nodes[node] = first[node] = np.mean([start for start, _ in ways], axis=0)
                continue
            place = _meeting(nodes[node], ways)
            moved = np.linalg.norm(place - first[node])
            nodes[node] = place if moved <= SECTIONS.max_move * wide[node] else first[node]
    return [_whole(line, nodes, degree) for line in lines]


def _whole(axis: CentreLine, nodes: FloatArray, degree: IntArray) -> CentreLine:
    """Return an axis that begins and ends at its joints."""
    a, b = (nodes[[k]] if degree[k] > 1 else nodes[:0] for k in axis.ends)
    radius = np.pad(axis.radius, (len(a), len(b)), mode="edge")
    return replace(axis, line=np.vstack([a, axis.line, b]), radius=radius)


def _sections(axis: CentreLine, wide: FloatArray, rays: _Rays) -> CentreLine:
    """Cut a vessel across its line outside of its joints, whose radii are `wide`, 0 at ends."""
    radius, line = float(np.median(axis.radius)), axis.line
    arc = arc_lengths(line)
    joint = wide[list(axis.ends)]
    cut = 1.2 * joint
    if arc[-1] - cut.sum() < radius / 2:
        cut = 0.8 * arc[-1] * joint / (joint.sum() or 1.0)
    count = max(3, int(np.ceil((arc[-1] - cut.sum()) / (radius / 2))) + 1)
    at = np.linspace(cut[0], arc[-1] - cut[1], count)
    way = places_along(line, arc, np.minimum(at + radius, arc[-1]))
    way -= places_along(line, arc, np.maximum(at - radius, 0.0))
    way /= np.linalg.norm(way, axis=1)[:, None]
    place = places_along(line, arc, at)
    reach = SECTIONS.reach * max(radius, *joint)
    found = [rays.section(*one, reach) for one in zip(place, way, strict=True)]
    at = at[[one is not None for one in found]]
    if len(at) < 3:
        return replace(axis, line=line[[0, -1]], radius=np.full(2, radius), is_sure=False)
    cuts = np.array([one for one in found if one is not None])
    own, is_sure = _own(cuts[:, 3], cuts[:, 4])
    # A bend's sections are too wide, their middles good.
    radius_at = np.interp(at, at[own], cuts[own, 3])
    span = slice(own[0], own[-1] + 1)
    centre, radius_at = cuts[span, :3], radius_at[span]
    if joint[1] == 0:
        centre, radius_at = _to_its_end(centre, radius_at, rays)
    if joint[0] == 0:
        centre, radius_at = (one[::-1] for one in _to_its_end(centre[::-1], radius_at[::-1], rays))
    return replace(axis, line=centre, radius=radius_at, is_sure=axis.is_sure and is_sure)


def _own(radius: FloatArray, shape: FloatArray) -> tuple[IntArray, bool]:
    """Return the sections that are like their neighbours, and whether they are a round lumen's."""
    change = np.abs(np.diff(radius)) / radius[1:]
    alike = change < SECTIONS.even + 1.5 * float(np.median(change))
    alike &= np.maximum(shape[1:], shape[:-1]) < 1.1 * np.median(shape)
    middle = float(np.median(radius))
    even = np.zeros(len(radius), dtype=np.bool_)
    even[1:-1] = alike[1:] & alike[:-1] & (radius[1:-1] < SECTIONS.wider * middle)
    own = np.flatnonzero(ndimage.binary_dilation(even))
    is_sure = len(own) > 2 and float(np.median(shape)) < SECTIONS.max_aspect
    return (own, is_sure) if len(own) > 2 else (np.arange(len(radius)), False)


def _to_its_end(
    centre: FloatArray, radius: FloatArray, rays: _Rays
) -> tuple[FloatArray, FloatArray]:
    """Go straight on to the face that a lumen opens through, or to the wall of its blind end."""
    wide = float(radius[-1])
    way = centre[-1] - centre[max(-5, -len(centre))]
    way /= np.linalg.norm(way)
    onward = rays.to_end(centre[-1], way, wide)
    if not 0 < onward <= SECTIONS.reach * wide:
        return centre, radius
    spacing = np.linalg.norm(np.diff(centre[-8:], axis=0), axis=1)
    slope = float(np.median(np.diff(radius[-8:]) / spacing))
    end = wide + onward * float(np.clip(slope, -SECTIONS.steepest, SECTIONS.steepest))
    return np.vstack([centre, centre[-1] + onward * way]), np.append(radius, end)


def _ways_into(node: int, axes: list[CentreLine]) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Places and directions of the axes that lead to a node."""
    for axis in axes:
        for end, line in zip(axis.ends, (axis.line, axis.line[::-1]), strict=True):
            if end == node:
                way = line[0] - line[1]
                if (size := float(np.linalg.norm(way))) > 0:
                    yield line[0], way / size


def _meeting(near: FloatArray, ways: list[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Return the place nearest to all lines; ones that run alike leave it at `near`."""
    pull = 0.01
    left, right = pull * np.eye(3), pull * near
    for place, way in ways:
        off = np.eye(3) - np.outer(way, way)
        left, right = left + off, right + off @ place
    return np.asarray(np.linalg.solve(left, right))


def _network(axes: list[CentreLine]) -> VesselNetwork:
    rows = [np.column_stack([axis.line, axis.radius]) for axis in axes]
    rows = [one[straighten_line(one, SECTIONS.straight_mm)[0]] for one in rows]
    used, number = np.unique([axis.ends for axis in axes], return_inverse=True)
    ends = number.reshape(-1, 2).astype(np.int64)
    nodes = np.zeros((len(used), 3))
    nodes[ends] = [one[[0, -1], :3] for one in rows]
    every = np.vstack(rows)
    return VesselNetwork(
        nodes,
        ends,
        np.full(len(axes), int(VesselKind.CHANNEL)),
        connected_parts(ends, len(used))[ends[:, 0]],
        np.cumsum([0, *(len(one) for one in rows)]),
        every[:, :3],
        every[:, 3],
    )


def _checked(network: VesselNetwork, is_sure: list[bool], hollow: Hollow) -> FoundLumens:
    """Compare the vessels' tubes with the lumens' voxels: each is to lie in one."""
    pitch, degree = hollow.pitch, network.degree()
    covered = np.zeros_like(hollow.inside)
    places, wides, along, off = [], [], [], []
    for vessel, length in enumerate(network.lengths().tolist()):
        line, radius = network.polyline(vessel)
        arc = arc_lengths(line)
        at = np.linspace(0.0, arc[-1], int(np.ceil(arc[-1] / pitch)) + 2)
        place, wide = places_along(line, arc, at), np.interp(at, arc, radius)
        voxel = (place - hollow.origin) / pitch
        for one, reach in zip(
            voxel, wide + np.maximum(SECTIONS.aside * wide, 2 * pitch), strict=True
        ):
            paint_ball(covered, one, reach / pitch)
        # A blind end's wall is ahead.
        blind = [degree[k] == 1 for k in network.vessel_nodes[vessel]]
        ahead = np.minimum(at if blind[0] else np.inf, length - at if blind[1] else np.inf)
        core = np.minimum((1 - SECTIONS.aside) * wide, ahead) - 2 * pitch
        wall = pitch * ndimage.map_coordinates(hollow.wall, voxel.T, order=1, mode="nearest")
        bad = (
            (np.abs(np.gradient(wide, at)) > SECTIONS.steepest)
            | (wall < core)
            | (wide < 1.5 * pitch)
        )
        bad |= not is_sure[vessel]
        bad |= not any(blind) and length < 2 * wide.max()
        places.append(place)
        wides.append(wide)
        along.append(at)
        off.append(bad)
    of = np.repeat(np.arange(len(along)), [len(one) for one in along])
    unsure, wide, place = np.concatenate(off), np.concatenate(wides), np.vstack(places)
    tree = cKDTree(place)
    label, _ = ndimage.label(hollow.inside & ~covered, ALL_NEIGHBOURS)
    part, count = ndimage.label(hollow.inside, ALL_NEIGHBOURS)
    lost = np.zeros(count + 1)
    left, left_at = [], []
    for number, box in enumerate(ndimage.find_objects(label), 1):
        index = np.argwhere(label[box] == number) + [one.start for one in box]
        near = tree.query(hollow.origin + pitch * index)[1]
        ball = 4 / 3 * np.pi * (SECTIONS.min_left * float(wide[near].min())) ** 3
        if len(index) * pitch**3 >= ball:
            unsure[near] = True
            lost[part[tuple(index[0])]] += len(index)
            left.append(len(index))
            left_at.append(hollow.origin + pitch * index[len(index) // 2])
    # Of lumens far from round no vessel is one.
    lost /= np.bincount(part.ravel(), minlength=count + 1)
    sample = np.round((place - hollow.origin) / pitch).astype(int)
    sample = np.clip(sample, 0, np.array(part.shape) - 1)
    unsure |= np.isin(of, of[lost[part[tuple(sample.T)]] > SECTIONS.max_left])
    stretches = tuple(
        _stretches(along[k], unsure[of == k], wide[of == k]) for k in range(network.vessel_count)
    )
    order = np.argsort(left)[::-1]
    share = sum(left) / int(hollow.inside.sum())
    return FoundLumens(network, share, np.reshape(left_at, (-1, 3))[order], stretches)


def _stretches(
    at: FloatArray, unsure: BoolArray, wide: FloatArray
) -> tuple[tuple[float, float], ...]:
    """Return runs of unsure places, each longer by a radius at both ends, along a vessel."""
    out: list[tuple[float, float]] = []
    for k in np.flatnonzero(unsure):
        first, last = max(0.0, float(at[k] - wide[k])), min(float(at[-1]), float(at[k] + wide[k]))
        if out and first <= out[-1][1]:
            first, last = out[-1][0], max(last, out.pop()[1])
        out.append((first, last))
    return tuple(out)
