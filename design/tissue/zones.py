"""Cut keep-out zones (rods, balls, boxes, meshes) out of a tissue, or keep only what is in zones.

A round zone is cut as a polyhedron around it (a polyhedron within it where the tissue is kept
within), so that what the user keeps free is free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import acos, ceil, cos, pi

import numpy as np
from manifold3d import Error, Manifold, Mesh64, OpType
from numpy.typing import NDArray

from design.errors import TissueError
from design.geometry.mesh import edges_of, merge_distances
from design.geometry.polyline import vectors_across
from design.geometry.surface import Surface
from design.tissue.closed import face_areas, merged_surface

Place = tuple[float, float, float]
MAX_SAGITTA_MM = 0.005
"""Between a round zone and its polyhedron, far below a printed line."""
MIN_SIDES, MAX_SIDES = 24, 256
MIN_SHARE = 1e-9
"""Of the tissue, in a zone or left by it; less is rounding."""


@dataclass(frozen=True)
class CylinderZone:
    """A round rod between the centres of its ends, mm."""

    from_mm: Place
    to_mm: Place
    radius_mm: float


@dataclass(frozen=True)
class SphereZone:
    """A ball, mm."""

    centre_mm: Place
    radius_mm: float


@dataclass(frozen=True)
class BlockZone:
    """A box along the axes between two opposite corners, mm."""

    from_mm: Place
    to_mm: Place


@dataclass(frozen=True)
class MeshZone:
    """What a closed surface encloses; ``name`` is for messages."""

    surface: Surface
    name: str = "mesh"


Zone = CylinderZone | SphereZone | BlockZone | MeshZone


def carve(
    surface: Surface, keep_out: Sequence[Zone] = (), keep_within: Sequence[Zone] = ()
) -> tuple[Surface, tuple[str, ...]]:
    """Cut zones out of a surface, exactly, and keep what lies within others.

    Parameters
    ----------
    surface : Surface
        Of the tissue.
    keep_out : sequence of zones
        Taken away.
    keep_within : sequence of zones
        Only what lies in at least one of them is kept; all, where there are none.

    Returns
    -------
    Surface
        In float32 steps; the same object when there is nothing to cut.
    notes : tuple of str
        Zones that miss the tissue, and whether it fell into pieces.

    Raises
    ------
    TissueError
        When a zone is impossible, takes the whole tissue, or a surface can't be cut.
    """
    if not keep_out and not keep_within:
        return surface, ()
    body = manifold_of(surface, "the tissue")
    whole, notes = body.volume(), []
    if keep_within:
        parts = [_solid(zone, f"keep_within {n + 1}", -1) for n, zone in enumerate(keep_within)]
        notes += _missing("keep_within", keep_within, parts, body)
        body ^= Manifold.batch_boolean(parts, OpType.Add)
        _require_rest(body, whole, "keep_within leaves nothing of the tissue")
    if keep_out:
        parts = [_solid(zone, f"keep_out {n + 1}", 1) for n, zone in enumerate(keep_out)]
        notes += _missing("keep_out", keep_out, parts, body)
        for n, part in enumerate(parts):
            name = zone_label("keep_out", n, keep_out[n])
            _require_rest(body - part, whole, f"{name} takes the whole tissue")
        body = Manifold.batch_boolean([body, *parts], OpType.Subtract)
        _require_rest(body, whole, "the keep_out zones together take the whole tissue")
    notes += _pieces(body)
    return surface_of(body, "the tissue"), tuple(notes)


def zone_label(key: str, number: int, zone: Zone) -> str:
    """A zone's name in messages, counted from 1."""
    if isinstance(zone, MeshZone):
        return f"{key} {number + 1} ({zone.name})"
    kind = type(zone).__name__.removesuffix("Zone").lower()
    return f"{key} {number + 1} ({kind})"


def zone_surface(zone: Zone, name: str) -> Surface:
    """A zone's own closed surface, mm; ``name`` identifies it in errors.

    Raises
    ------
    TissueError
        When it has no volume, or its mesh isn't closed.
    """
    return surface_of(_solid(zone, name, -1), name)


def _missing(key: str, zones: Sequence[Zone], parts: list[Manifold], body: Manifold) -> list[str]:
    least = MIN_SHARE * body.volume()
    return [
        f"{zone_label(key, n, zones[n])} doesn't meet the tissue and changes nothing; "
        "check its place"
        for n, part in enumerate(parts)
        if (body ^ part).volume() <= least
    ]


def _require_rest(body: Manifold, whole: float, message: str) -> None:
    if body.is_empty() or body.volume() <= MIN_SHARE * whole:
        raise TissueError(f"{message}; make the zone smaller or move it")


def _pieces(body: Manifold) -> list[str]:
    volumes = sorted((piece.volume() for piece in body.decompose()), reverse=True)
    # What `decompose` gives for a cavity has a negative volume.
    solid = [volume for volume in volumes if volume > 0]
    if len(solid) < 2:
        return []
    shares = ", ".join(f"{100 * volume / sum(solid):.3g} %" for volume in solid[:4])
    more = ", …" if len(solid) > 4 else ""
    return [
        f"the zones cut the tissue into {len(solid)} pieces ({shares}{more} of it); each wants "
        "vessels of its own (inlets: each_part; with a template a recipe for each)"
    ]


def _solid(zone: Zone, name: str, sign: int) -> Manifold:
    """The zone as a solid; ``sign`` +1 around it, -1 within it."""
    match zone:
        case MeshZone():
            return manifold_of(zone.surface, f"{name} ({zone.name})")
        case BlockZone():
            return _block(zone, name)
        case SphereZone():
            return _ball(zone, name, sign)
        case CylinderZone():
            return _rod(zone, name, sign)


def _block(zone: BlockZone, name: str) -> Manifold:
    low = np.minimum(zone.from_mm, zone.to_mm)
    size = np.abs(np.subtract(zone.to_mm, zone.from_mm))
    if not (size > 0).all():
        raise TissueError(f"{name}: block of {size.tolist()} mm is flat; give three sides above 0")
    return Manifold.cube(size.tolist()).translate(low.tolist())


def _ball(zone: SphereZone, name: str, sign: int) -> Manifold:
    _positive(zone.radius_mm, name)
    ball = Manifold.sphere(1.0, 4 * ceil(_sides(zone.radius_mm) / 4))
    radius = zone.radius_mm / _inner_radius(*arrays_of(ball)) if sign > 0 else zone.radius_mm
    return ball.scale((radius, radius, radius)).translate(zone.centre_mm)


def _inner_radius(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> float:
    """Radius of the ball about the origin that a polyhedron around it holds."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    six_volumes = np.einsum("ij,ij->i", a, np.cross(b, c))
    return float((six_volumes / (2.0 * face_areas(vertices, faces))).min())


def _rod(zone: CylinderZone, name: str, sign: int) -> Manifold:
    _positive(zone.radius_mm, name)
    way = np.subtract(zone.to_mm, zone.from_mm)
    length = float(np.linalg.norm(way))
    if not length > 0:
        raise TissueError(f"{name}: cylinder has no length; move from_mm and to_mm apart")
    sides = _sides(zone.radius_mm)
    radius = zone.radius_mm / cos(pi / sides) if sign > 0 else zone.radius_mm
    axis = way / length
    frame = np.column_stack([*vectors_across(axis), axis, zone.from_mm])
    return Manifold.cylinder(length, radius, radius, sides).transform(frame)


def _positive(radius: float, name: str) -> None:
    if not (np.isfinite(radius) and radius > 0):
        raise TissueError(f"{name}: radius_mm is {radius:g}; give a radius above 0")


def _sides(radius: float) -> int:
    """Return the sides of a polygon within `MAX_SAGITTA_MM` of its circle."""
    if radius <= MAX_SAGITTA_MM:
        return MIN_SIDES
    return min(max(MIN_SIDES, ceil(pi / acos(1.0 - MAX_SAGITTA_MM / radius))), MAX_SIDES)


def manifold_of(surface: Surface, what: str) -> Manifold:
    """Hand a surface to manifold3d.

    Raises
    ------
    TissueError
        When ``what`` isn't a closed, oriented 2-manifold.
    """
    return distinct_manifold(Surface(*merged_surface(surface.vertices, surface.faces)), what)


def distinct_manifold(surface: Surface, what: str) -> Manifold:
    """As `manifold_of`, for a surface without two vertices in one place."""
    points, faces = np.ascontiguousarray(surface.vertices), surface.faces
    manifold = Manifold(Mesh64(points, np.ascontiguousarray(faces, dtype=np.uint64)))
    if manifold.status() != Error.NoError:
        edges = edges_of(faces)
        raise TissueError(
            f"{what} can't be cut or united: {int((edges.uses != 2).sum())} of {len(edges.uses)} "
            f"edges don't have two faces ({manifold.status().name}); mend the mesh"
        )
    return manifold


def surface_of(manifold: Manifold, what: str, touching: bool = False) -> Surface:
    """The surface of a boolean's result, rounded to float32 without opening it.

    Files of meshes hold float32; a surface that is so already is the same in the file. Vertices
    closer together than its steps are merged first, over the first of `merge_distances` that leaves
    no edge with four faces; with ``touching`` such edges, in which parts touch, may stay.

    Raises
    ------
    TissueError
        When ``what`` is empty or doesn't stay closed.
    """
    if manifold.is_empty():
        raise TissueError(f"nothing is left of {what}")
    for step in merge_distances(np.array(manifold.bounding_box())):
        rounded = _rounded(manifold.simplify(step))
        if rounded is not None:
            return rounded
    if touching and (rounded := _rounded(manifold, touching)) is not None:
        return rounded
    raise TissueError(
        f"{what} doesn't stay closed when rounded to float32: parts of it touch in an edge or a "
        "point; move them apart or let them overlap"
    )


def _rounded(manifold: Manifold, touching: bool = False) -> Surface | None:
    """The surface in float32, or None where that has edges without two (four) faces."""
    vertices, faces = arrays_of(manifold)
    # Adding 0 turns -0 into 0: they are one place.
    near = vertices.astype(np.float32).astype(np.float64) + 0.0
    points, corners = merged_surface(near, faces)
    edges = edges_of(corners)
    fits = edges.uses % 2 == 0 if touching else edges.uses == 2
    if len(corners) and fits.all() and not edges.turned:
        return Surface(points, corners)
    return None


def arrays_of(manifold: Manifold) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Vertices (n, 3), mm, and faces (m, 3)."""
    mesh = manifold.to_mesh64()
    vertices = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3]
    return np.ascontiguousarray(vertices), np.asarray(mesh.tri_verts, dtype=np.int32)
