"""The three hundred tissues: what is in each file, and what truly lies in it.

A case knows its parts from how it was made. What is spoilt afterwards (faces without area, sheets,
joints at which a vertex is missing, faces turned) changes the file and not the truth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.tissue.solids import (
    Rng,
    Solid,
    ball,
    blobs,
    box,
    cylinder,
    doubled_faces,
    flat_faces,
    joined,
    manifold,
    missing_joints,
    of_manifold,
    parted_vertices,
    random_frame,
    stray_sheets,
    torus,
    turned_faces,
    turned_shells,
    volume_of,
)


@dataclass(frozen=True)
class Case:
    """A tissue as it goes to the file, and the parts that truly lie in it.

    Clean solids make up each part; a point is in a part when it is in any of them. ``lobes``: the
    parts hang together, by necks that a vessel may be too wide for.
    """

    name: str
    mesh: Solid
    parts: tuple[tuple[Solid, ...], ...]
    lobes: bool = False


def _apart(rng: Rng) -> Case:
    """Two to six solids that don't meet."""
    found: list[Solid] = []
    at = 0.0
    for _ in range(rng.integers(2, 7)):
        one = _some(rng).turned(random_frame(rng))
        low, high = one.points.min(axis=0), one.points.max(axis=0)
        place = np.array([at - low[0], *rng.uniform(-5, 5, 2)])
        found.append(one.moved(place))
        at += high[0] - low[0] + rng.uniform(0.05, 4)
    return _case(f"{len(found)} solids apart", found)


def _some(rng: Rng) -> Solid:
    a, b, c = rng.uniform(4, 16, 3)
    kind = rng.integers(4)
    if kind == 0:
        return box((a, b, c))
    if kind == 1:
        return ball(a / 2).scaled((1, b / a, c / a))
    if kind == 2:
        return cylinder(a / 2, b)
    return torus(a / 2 + 2, rng.uniform(1.0, 2.0))


def _case(name: str, parts: list[Solid], mesh: Solid | None = None, lobes: bool = False) -> Case:
    return Case(name, mesh or joined(*parts), tuple((one,) for one in parts), lobes)


def _at_a_point(rng: Rng) -> Case:
    """Blocks corner to corner, or a ball's pole on a block."""
    one, two = box(rng.uniform(5, 14, 3).round(1)), box(rng.uniform(4, 10, 3).round(1))
    if rng.random() < 0.5:
        parts = [one, two.moved(one.points.max(axis=0))]
    else:
        radius = round(float(rng.uniform(3, 6)), 1)
        x, y, z = one.points.max(axis=0)
        parts = [one, ball(radius).moved((x / 2, y / 2, z + radius))]
    return _case("touching in a point", parts)


def _at_an_edge(rng: Rng) -> Case:
    """Blocks that share an edge, whole or in part."""
    one, two = box(rng.uniform(5, 14, 3).round(1)), box(rng.uniform(4, 10, 3).round(1))
    if rng.random() < 0.5:
        two = two.scaled((1, 1, one.points[:, 2].max() / two.points[:, 2].max()))
    shift = one.points.max(axis=0) * (1, 1, 0)
    if rng.random() < 0.4:
        shift += (0, 0, round(float(rng.uniform(0.5, 3)), 1))
    return _case("touching in an edge", [one, two.moved(shift)])


def _at_a_face(rng: Rng) -> Case:
    """Blocks that share a face, whole or in part: one piece of matter, two closed shells."""
    one, two = box(rng.uniform(6, 14, 3).round(1)), box(rng.uniform(4, 10, 3).round(1))
    if rng.random() < 0.4:
        ratio = one.points.max(axis=0) / two.points.max(axis=0)
        two = two.scaled((1, *ratio[1:]))
    shift = np.array([one.points[:, 0].max(), 0, 0])
    if rng.random() < 0.5:
        shift += [0, *rng.uniform(0.3, 3, 2).round(1)]
    pair = (one, two.moved(shift))
    return Case("touching in a face", joined(*pair), (pair,))


def _overlapping(rng: Rng) -> Case:
    """Solids that pass through one another: one part."""
    found = [_some(rng).turned(random_frame(rng)) for _ in range(rng.integers(2, 5))]
    found = [one.moved(-one.points.mean(axis=0) + rng.uniform(-2.5, 2.5, 3)) for one in found]
    group = list(found)
    whole = manifold(group[0])
    for one in group[1:]:
        whole += manifold(one)
    pieces = [piece for piece in whole.decompose() if piece.volume() > 0]
    if len(pieces) > 1 or any(p.volume() < 0 for p in whole.decompose()):
        group = [box((10, 10, 10)), box((10, 10, 10)).moved(rng.uniform(2, 7, 3))]
    return Case("overlapping solids", joined(*group), (tuple(group),))


def _shells(rng: Rng) -> Case:
    """Cavities, solids within cavities, to four levels; some within one another twice."""
    radius = float(rng.uniform(8, 15))
    levels = int(rng.integers(2, 6))
    radii = radius * np.cumprod([1.0, *rng.uniform(0.62, 0.8, levels - 1)])
    shape = ball if rng.random() < 0.6 else (lambda r: box((2 * r,) * 3).moved((-r,) * 3))
    frame = random_frame(rng)
    every = [shape(r).turned(frame).moved(0.04 * rng.uniform(-r, r, 3)) for r in radii]
    parts = []
    for n in range(0, levels, 2):
        hollow = [every[n]] if n + 1 == levels else [every[n], every[n + 1].inverted]
        parts.append(joined(*hollow))
    return _case(f"{levels} shells within one another", parts)


def _thin_walls(rng: Rng) -> Case:
    """Hollow balls, cups, sheets and tubes with walls of 0.3 to 1.2 mm."""
    wall = float(rng.uniform(0.3, 1.2))
    kind = rng.integers(4)
    r = float(rng.uniform(5, 14))
    if kind == 0:
        parts = [joined(ball(r, 24), ball(r - wall, 24).inverted)]
    elif kind == 1:
        parts = [box((*rng.uniform(10, 30, 2), wall)).turned(random_frame(rng))]
    elif kind == 2:
        tube = manifold(cylinder(r, 2 * r, 48)) - manifold(
            cylinder(r - wall, 3 * r, 48).moved((0, 0, wall))
        )
        parts = [of_manifold(tube).turned(random_frame(rng))]
    else:
        parts = [box((20, 14, wall)), box((20, 14, wall)).moved((0, 0, wall + 0.2))]
    return _case(f"walls of {wall:.2f} mm", parts)


def _holes(rng: Rng) -> Case:
    """A slab with up to 200 holes, drilled round, now and then with faces without area."""
    count = int(rng.choice([4, 30, 100, 200]))
    side = int(np.ceil(np.sqrt(count)))
    pitch = float(rng.uniform(1.6, 2.4))
    slab = manifold(box((pitch * (side + 1), pitch * (side + 1), rng.uniform(2, 5))))
    hole = cylinder(0.3 * pitch, 20, int(rng.choice([12, 24, 48])))
    many = [
        manifold(hole.moved((pitch * (1 + n % side), pitch * (1 + n // side), -5)))
        for n in range(count)
    ]
    for one in many:
        slab = slab - one
    solid = of_manifold(slab)
    mesh = flat_faces(solid, rng, 20) if rng.random() < 0.5 else solid
    if rng.random() < 0.5:
        frame = random_frame(rng)
        solid, mesh = solid.turned(frame), mesh.turned(frame)
    return _case(f"slab with {count} holes", [solid], mesh)


def _spoilt(how: Callable[[Solid, Rng, int], Solid]) -> Callable[[Rng], Case]:
    def make(rng: Rng) -> Case:
        one = _some(rng).turned(random_frame(rng))
        other = _some(rng).turned(random_frame(rng)).moved((40, 0, 0))
        parts = [one, other] if rng.random() < 0.5 else [one]
        mesh = how(joined(*parts), rng, int(rng.integers(1, 30)))
        return _case(how.__name__.replace("_", " "), parts, mesh)

    return make


def _lobes(rng: Rng) -> Case:
    """Two or three lobes joined by necks of 0.02 to 2 mm."""
    count = int(rng.integers(2, 4))
    neck = float(10 ** rng.uniform(-1.7, 0.3))
    radius = rng.uniform(4, 8, count)
    at, lobes, whole = 0.0, [], None
    for n in range(count):
        at += float(radius[n])
        lobe = ball(float(radius[n]), 20).moved((at, 0, 0))
        at += float(radius[n]) + 2.0
        lobes.append(lobe)
        whole = manifold(lobe) if whole is None else whole + manifold(lobe)
        if n + 1 < count:
            beam = box((4.0, neck, neck)).moved((at - 3.0, -neck / 2, -neck / 2))
            whole = whole + manifold(beam)
    assert whole is not None
    return _case(f"{count} lobes, necks of {neck:.2f} mm", lobes, of_manifold(whole), lobes=True)


def _many(rng: Rng) -> Case:
    """Ten to sixty balls and blocks in a lattice."""
    count = int(rng.integers(10, 61))
    found = []
    for n in range(count):
        size = float(rng.uniform(2.0, 4.8))
        one = ball(size / 2, 8) if rng.random() < 0.5 else _centred(size)
        found.append(one.moved(5.0 * np.array([n % 4, n // 4 % 4, n // 16])))
    return _case(f"{count} parts", found)


def _centred(size: float) -> Solid:
    return box((size,) * 3).moved((-size / 2,) * 3)


def _voxels(rng: Rng) -> Case:
    """Random blobs of cubes that meet in faces, edges and corners."""
    mesh, parts = blobs(rng)
    return Case(f"voxels in {len(parts)} parts", mesh, tuple((one,) for one in parts))


def _sized(rng: Rng) -> Case:
    """Two parts of very different sizes, 5 to 380 mm long in all."""
    whole = float(rng.choice([5.2, 20, 120, 380]))
    small = 10 ** rng.uniform(-1.2, -0.3)
    parts = [ball(0.25 * whole), box((0.25 * whole * small,) * 3).moved((0.3 * whole, 0, 0))]
    extent = np.ptp(joined(*parts).points, axis=0).max()
    parts = [one.scaled((whole / extent,) * 3) for one in parts]
    return _case(f"two parts, {whole:g} mm, one {small:.2f} as wide", parts)


def _linked(rng: Rng) -> Case:
    """Rings linked as in a chain, each within another's bounds."""
    thick = float(rng.uniform(0.8, 1.6))
    rings = [torus(8.0, thick)]
    swap = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    for n in range(int(rng.integers(1, 4))):
        turned = torus(8.0, thick).turned(swap) if n % 2 == 0 else torus(8.0, thick)
        rings.append(turned.moved((10.0 * (n + 1), 0, 0)))
    return _case(f"{len(rings)} linked rings", rings)


KINDS: dict[str, Callable[[Rng], Case]] = {
    "apart": _apart,
    "point": _at_a_point,
    "edge": _at_an_edge,
    "face": _at_a_face,
    "overlapping": _overlapping,
    "shells": _shells,
    "thin": _thin_walls,
    "holes": _holes,
    "flat": _spoilt(flat_faces),
    "doubled": _spoilt(doubled_faces),
    "sheets": _spoilt(stray_sheets),
    "joints": _spoilt(missing_joints),
    "inverted": _spoilt(turned_faces),
    "inside_out": _spoilt(turned_shells),
    "unmerged": _spoilt(parted_vertices),
    "lobes": _lobes,
    "many": _many,
    "voxels": _voxels,
    "sizes": _sized,
    "linked": _linked,
}
"""Makers by kind; a case is a kind and a seed."""

SEEDS = 15


def make(kind: str, seed: int) -> Case:
    """A case."""
    return KINDS[kind](np.random.default_rng([seed, list(KINDS).index(kind)]))


def true_volume(part: tuple[Solid, ...]) -> float:
    """Of a part, mm³; of overlapping solids by manifold3d's union."""
    if len(part) == 1:
        return volume_of(part[0])
    whole = manifold(part[0])
    for one in part[1:]:
        whole += manifold(one)
    return float(whole.volume())
