"""Reconstruct a closed surface from a point cloud: partition of unity of local quadratics.

Around each point the surface is a quadratic height over the tangent plane, fitted to its
neighbours (and to their normals, where they are given); the local functions, blended by compact
weights (Ohtake et al. 2003, doi 10.1145/882262.882293, who blend over cells instead), are sampled
on a lattice finer than the points' spacing, and the surface is where the blend is 0. Places that no
point reaches take the sign around them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, sqrt
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, find_objects, label
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from design.errors import TissueError
from design.geometry import build_triangle_tree, nearest_distances
from design.geometry.polyline import vectors_across
from design.geometry.surface import Surface
from design.tissue.closed import format_points, isosurface
from design.tissue.load import check_file
from design.tissue.parts import shells_of
from design.tissue.surface import SizeLimits, check_size
from design.tissue.zones import distinct_manifold, surface_of
from design.units import MM_PER, LengthUnit
from kernels import jit
from kernels.arrays import FloatArray


class PointFit(NamedTuple):
    """How a surface is laid through points; lengths in the points' spacing."""

    min_points: int = 100
    neighbours: int = 14  # Fitted together: twice a quadratic's coefficients, and some to spare
    reach: float = 2.0  # Of a local function around its point
    # Least cosine between normals fitted together; others are beyond an edge.
    same_side: float = 0.5
    # Bounds of a height's coefficients: beyond an edge a fit holds nothing, and bends tighter
    # than four spacings aren't resolved.
    steepest: tuple[float, ...] = (0.5, 0.5, 0.5, 0.12, 0.12, 0.12)
    max_nodes: int = 40_000_000  # Of the lattice: 640 MB
    cells_per_spacing: float = 1.5
    far: float = 1.6  # From the nearest point; beyond, the surface is invented
    max_invented: float = 0.05  # Share of the surface that may be, and from which on it is noted
    noted: float = 0.002
    simplify: float = 0.02  # How far simplifying may move the surface


FIT = PointFit()


@dataclass(frozen=True)
class Cloud:
    """Points with what lies around each.

    Attributes
    ----------
    points, normals : (n, 3) float64, mm
    neighbours : (n, k) int64
    spacing : (n,) float64, mm
        Mean distance between points there, from the density of the neighbours.
    """

    points: FloatArray
    normals: FloatArray
    # Fitted together: twice a quadratic's coefficients, and some to spare.
    neighbours: NDArray[np.int64]
    spacing: FloatArray


def load_point_surface(
    path: Path, unit: LengthUnit, *, limits: SizeLimits | None = None
) -> tuple[Surface, tuple[str, ...]]:
    """Read points of a surface (PLY, XYZ, TXT, CSV) and lay a closed surface through them, in mm.

    Parameters
    ----------
    path : Path
    unit : {"um", "mm", "cm", "m", "in"}
        Of the coordinates; never guessed.
    limits : SizeLimits, optional

    Returns
    -------
    Surface
    notes : tuple of str
        The points' spacing, how far they are from the surface, whether normals were estimated.

    Raises
    ------
    TissueError
        When the file can't be used, or the points leave gaps.
    """
    path = Path(path)
    check_file(path, unit, POINT_SUFFIXES)
    points, normals = read_points(path)
    try:
        check_size(points, unit, limits or SizeLimits())
        surface, notes = point_surface(points * MM_PER[unit], normals)
    except TissueError as error:
        raise TissueError(f"{path}: {error}") from error
    return surface, tuple(f"{path.name}: {note}" for note in notes)


def point_surface(
    points: FloatArray, normals: FloatArray | None = None
) -> tuple[Surface, tuple[str, ...]]:
    """Closed surface through points (n, 3), mm, with outward ``normals`` (n, 3) or without.

    Raises
    ------
    TissueError
        When there are too few points, normals are 0 or NaN, or the points leave gaps.
    """
    cloud, notes = _cloud(points, normals)
    height = _fit(cloud, hermite=normals is not None)
    origin, h, shape = _lattice(cloud)
    total, weight = np.zeros(shape), np.zeros(shape)
    frame = _frames(cloud.normals)
    reach = np.maximum(FIT.reach * cloud.spacing, 2.0 * h)
    blend(cloud.points, frame, height, reach, origin, h, total, weight)
    shell = isosurface(-_filled(total, weight, h), 0.0)
    surface = Surface(shell.vertices * h + origin, shell.faces)
    kept, more = _checked(surface, cloud)
    notes += more
    solid = distinct_manifold(kept, "the surface of the points")
    typical = float(np.median(cloud.spacing))
    final = surface_of(solid.simplify(FIT.simplify * typical), "the surface of the points")
    away = nearest_distances(build_triangle_tree(final.vertices, final.faces), cloud.points)
    notes.append(
        f"surface laid through {len(cloud.points)} points about {typical:.3g} mm apart; they lie "
        f"{1e3 * np.sqrt(np.mean(away**2)):.3g} µm (rms) and at most {1e3 * away.max():.3g} µm "
        "from it"
    )
    return final, tuple(notes)


def _cloud(points: FloatArray, normals: FloatArray | None) -> tuple[Cloud, list[str]]:
    """Distinct points, their neighbours, spacing and unit normals."""
    places, first = np.unique(points, axis=0, return_index=True)
    if len(places) < FIT.min_points:
        raise TissueError(f"{len(places)} points aren't a surface; give at least {FIT.min_points}")
    away, near = cKDTree(places).query(places, FIT.neighbours + 1)
    neighbours = near[:, 1:].astype(np.int64)
    # Of a plane with points d apart, k lie within d √(k / π).
    spacing = away[:, -1] * np.sqrt(np.pi / FIT.neighbours)
    if normals is None:
        directions, parts = estimate_normals(places, neighbours)
        notes = ["points have no normals; they were estimated, each part's looking outward"]
        if parts > 1:
            notes.append(
                f"points fall into {parts} separate parts; if one is a cavity's, give normals"
            )
        return Cloud(places, directions, neighbours, spacing), notes
    length = np.linalg.norm(normals[first], axis=1)
    if not (np.isfinite(length).all() and (length > 0).all()):
        bad = np.flatnonzero(~(np.isfinite(length) & (length > 0)))
        raise TissueError(
            f"{len(bad)} normals are 0 or NaN ({format_points(places[bad])}); "
            "mend or leave them out"
        )
    return Cloud(places, normals[first] / length[:, None], neighbours, spacing), []


def _frames(normals: FloatArray) -> FloatArray:
    """Two tangents and the normal of each point, (n, 3, 3), as rows."""
    return np.stack([*vectors_across(normals), normals], axis=1)


def _fit(cloud: Cloud, hermite: bool) -> FloatArray:
    """Heights' coefficients (n, 6) by weighted least squares; lengths in spacings while solving.

    Each neighbour's height counts and, with ``hermite``, its normal's slope as well.
    """
    frame, s = _frames(cloud.normals), cloud.spacing
    there = np.concatenate([np.arange(len(s))[:, None], cloud.neighbours], axis=1)
    offset = (cloud.points[there] - cloud.points[:, None]) / s[:, None, None]
    u, v, w = (np.einsum("nki,ni->nk", offset, frame[:, axis]) for axis in range(3))
    nu, nv, nw = (np.einsum("nki,ni->nk", cloud.normals[there], frame[:, a]) for a in range(3))
    weight = np.exp(-0.25 * (offset**2).sum(axis=2))
    weight *= np.clip((nw - FIT.same_side) / (1.0 - FIT.same_side), 0.0, 1.0)
    zero, one = np.zeros_like(u), np.ones_like(u)
    rows = [np.stack([one, u, v, u * u, u * v, v * v], axis=2)]
    aims, weights = [w], [weight]
    if hermite:
        slope = np.maximum(nw, FIT.same_side)
        rows.append(np.stack([zero, one, zero, 2 * u, v, zero], axis=2))
        rows.append(np.stack([zero, zero, one, zero, u, 2 * v], axis=2))
        aims += [-nu / slope, -nv / slope]
        weights += [0.5 * weight, 0.5 * weight]
    a, b, p = (np.concatenate(parts, axis=1) for parts in (rows, aims, weights))
    left = np.einsum("nki,nk,nkj->nij", a, p, a) + 1e-6 * np.eye(6)
    right = np.einsum("nki,nk,nk->ni", a, p, b)
    solved: FloatArray = np.linalg.solve(left, right[..., None])[..., 0]
    coefficients = np.clip(solved, np.negative(FIT.steepest), FIT.steepest)
    return coefficients * np.stack([s, one[:, 0], one[:, 0], 1 / s, 1 / s, 1 / s], axis=1)


def _lattice(cloud: Cloud) -> tuple[FloatArray, float, tuple[int, int, int]]:
    """Origin, spacing and size of the lattice."""
    margin = (FIT.reach + 1.0) * float(cloud.spacing.max())
    low, high = cloud.points.min(axis=0) - margin, cloud.points.max(axis=0) + margin
    typical = float(np.percentile(cloud.spacing, 20))
    h = typical / FIT.cells_per_spacing
    count = float(np.prod((high - low) / h + 2))
    if count > FIT.max_nodes:
        h *= (count / FIT.max_nodes) ** (1 / 3)
    if h > typical:
        raise TissueError(
            f"points {typical:.3g} mm apart need a lattice of {count:.2g} nodes, above "
            f"{FIT.max_nodes:.2g}; thin the points out or cut the cloud into parts"
        )
    size = np.ceil((high - low) / h).astype(int) + 2
    return low, h, (int(size[0]), int(size[1]), int(size[2]))


def _filled(total: FloatArray, weight: FloatArray, h: float) -> FloatArray:
    """The blend, negative inside, with the sign of what is around where no point reaches."""
    covered = weight > 0
    value = np.divide(total, weight, out=np.full_like(total, np.inf), where=covered)
    parts, count = label(~covered)
    outer = int(parts[0, 0, 0])
    if count == 0 or outer == 0:
        raise TissueError("points leave no outside around them; check for stray points")
    if (value[covered & binary_dilation(parts == outer)] < 0).mean() > 0.5:
        # The normals look inward.
        value = np.where(covered, -value, value)
    for part, box in enumerate(find_objects(parts), start=1):
        if part != outer:
            around = tuple(slice(max(0, side.start - 1), side.stop + 1) for side in box)
            here = parts[around] == part
            rim = covered[around] & binary_dilation(here)
            value[around][here] = -np.inf if (value[around][rim] < 0).mean() > 0.5 else np.inf
    return np.clip(value, -4.0 * h, 4.0 * h)


def _checked(surface: Surface, cloud: Cloud) -> tuple[Surface, list[str]]:
    """The shells that points lie on, and a note where they are made up; raises if too much is.

    At the far end of its reach a quadratic may bend back through 0: such shells have no points.
    """
    if len(surface.faces) == 0:
        raise TissueError("points enclose nothing; check them, and that their normals agree")
    middle = surface.vertices[surface.faces].mean(axis=1)
    away, near = cKDTree(cloud.points).query(middle)
    far = away / cloud.spacing[near]
    shell = shells_of(surface.vertices, surface.faces)
    mean = np.bincount(shell, weights=far) / np.bincount(shell)
    kept = mean[shell] < FIT.far
    invented = np.flatnonzero((far > FIT.far) & (kept | (not kept.any())))
    share = len(invented) / max(1, int(kept.sum()))
    worst = middle[invented[np.argsort(-far[invented])]]
    where = f"is farther than {FIT.far:g} spacings from any point ({format_points(worst)})"
    if share > FIT.max_invented:
        raise TissueError(
            f"points leave gaps, or their normals disagree: {100 * share:.2g} % of the surface "
            f"{where}; add points there, or give normals"
        )
    notes = [f"{100 * share:.2g} % of the surface {where}"] if share > FIT.noted else []
    number = np.cumsum(np.bincount(surface.faces[kept].ravel()) > 0) - 1
    used = np.unique(surface.faces[kept])
    return Surface(surface.vertices[used], number[surface.faces[kept]].astype(np.int32)), notes


MIN_EDGE_WEIGHT = 1e-3
"""Added to each edge's weight, of 0 to 3: a sparse matrix takes a weight of 0 for no edge."""


def estimate_normals(points: FloatArray, neighbours: NDArray[np.int64]) -> tuple[FloatArray, int]:
    """Normals from the neighbours' least extent, made to agree along a least spanning tree.

    Edges weigh 1 - |cosine| between their ends' normals, and more the more they run along them,
    so that orientation is handed on where the surface is flat and within one sheet. Each separate
    part begins at its highest point, whose normal looks up.

    Parameters
    ----------
    points : (n, 3) float64
    neighbours : (n, k) int64
        Nearest points of each, itself left out.

    Returns
    -------
    normals : (n, 3) float64
    parts : int
        Separate parts of the neighbours' graph.
    """
    around = points[neighbours] - points[neighbours].mean(axis=1, keepdims=True)
    covariance = np.einsum("nki,nkj->nij", around, around)
    normals: FloatArray = np.linalg.eigh(covariance)[1][:, :, 0]
    one = np.repeat(np.arange(len(points)), neighbours.shape[1])
    two = neighbours.ravel()
    cosine = np.minimum(np.abs(np.einsum("ij,ij->i", normals[one], normals[two])), 1.0)
    way = points[two] - points[one]
    way /= np.linalg.norm(way, axis=1)[:, None]
    # A step along the normals leads to another sheet: across a narrow gap, or through a wall.
    across = sum(np.einsum("ij,ij->i", normals[end], way) ** 2 for end in (one, two))
    cost = 1.0 - cosine + across + MIN_EDGE_WEIGHT
    low, high = np.minimum(one, two), np.maximum(one, two)
    _, kept = np.unique(low * len(points) + high, return_index=True)
    shape = (len(points), len(points))
    tree = minimum_spanning_tree(
        coo_matrix((cost[kept], (low[kept], high[kept])), shape=shape).tocsr()
    )
    parts, part = connected_components(tree, directed=False)
    for number in range(parts):
        members = np.flatnonzero(part == number)
        top = int(members[np.argmax(points[members, 2])])
        _hand_on(normals, tree, top)
    return normals, int(parts)


def _hand_on(normals: FloatArray, tree: object, top: int) -> None:
    """Turn normals to agree with the one before them on the way from ``top``, in place."""
    if normals[top, 2] < 0:
        normals[top] *= -1.0
    order, before = breadth_first_order(tree, top, directed=False)
    # Signs multiply along the way, so a loop over the points in order is enough.
    for here in order[1:]:
        if normals[here] @ normals[before[here]] < 0:
            normals[here] *= -1.0


CORE_SHARE = 0.2
"""Of the reach: within it, whether a place lies beside a point or over it matters little."""


@jit
def blend(
    points: Any,
    frame: Any,
    height: Any,
    reach: Any,  # Of a local function around its point
    origin: Any,
    spacing: float,
    total: Any,
    weight: Any,
) -> None:
    """Add each point's local surface to the lattice nodes within its reach.

    The local function of a point is w - h(u, v) in its frame, h a quadratic; its weight is
    Wendland's (1 - r)^4 (4 r + 1) of the distance r over the reach, and the less the more the
    place lies beside the point rather than along its normal: beyond a sharp edge the faces that
    end there would otherwise go on as fins.

    Parameters
    ----------
    points : (n, 3) float64, mm
    frame : (n, 3, 3) float64
        Rows: two tangents and the outward normal.
    height : (n, 6) float64
        Coefficients of 1, u, v, u², uv, v² in h.
    reach : (n,) float64, mm
    origin : (3,) float64, mm
        Node (0, 0, 0).
    total, weight : (a, b, c) float64
        Sums of weighted values and of weights, added to.
    """
    for n in range(len(points)):
        far = reach[n]
        first, last = [0, 0, 0], [0, 0, 0]
        for axis in range(3):
            middle = (points[n, axis] - origin[axis]) / spacing
            first[axis] = max(0, ceil(middle - far / spacing))
            last[axis] = min(total.shape[axis] - 1, floor(middle + far / spacing))
        f, c = frame[n], height[n]
        for i in range(first[0], last[0] + 1):
            x = origin[0] + i * spacing - points[n, 0]
            for j in range(first[1], last[1] + 1):
                y = origin[1] + j * spacing - points[n, 1]
                for k in range(first[2], last[2] + 1):
                    z = origin[2] + k * spacing - points[n, 2]
                    r = sqrt(x * x + y * y + z * z) / far
                    if r >= 1.0:
                        continue
                    u = f[0, 0] * x + f[0, 1] * y + f[0, 2] * z
                    v = f[1, 0] * x + f[1, 1] * y + f[1, 2] * z
                    w = f[2, 0] * x + f[2, 1] * y + f[2, 2] * z
                    h = c[0] + c[1] * u + c[2] * v + c[3] * u * u + c[4] * u * v + c[5] * v * v
                    near = (CORE_SHARE * far) ** 2
                    phi = (1.0 - r) ** 4 * (4.0 * r + 1.0)
                    phi *= (w * w + near) / (r * r * far * far + near)
                    total[i, j, k] += phi * (w - h)
                    weight[i, j, k] += phi


POINT_SUFFIXES: Final = (".ply", ".xyz", ".txt", ".csv")
_NORMAL = ("nx", "ny", "nz")


def read_points(path: Path) -> tuple[FloatArray, FloatArray | None]:
    """Points (n, 3) and, where the file has them, normals (n, 3).

    Text holds one point a line: x y z, or x y z nx ny nz, parted by blanks, commas or semicolons;
    a first line of names and lines that begin with # are passed over.

    Raises
    ------
    TissueError
        When the file can't be read, or has another number of columns.
    """
    if path.suffix.lower() == ".ply":
        return _read_ply(path)
    rows = _rows(path)
    widths = {len(row) for row in rows}
    if widths not in ({3}, {6}):
        raise TissueError(
            f"{path}: lines have {' or '.join(map(str, sorted(widths)))} columns; give x y z, or "
            "x y z nx ny nz"
        )
    table = np.array(rows, dtype=np.float64)
    return table[:, :3], table[:, 3:] if table.shape[1] == 6 else None


def _rows(path: Path) -> list[list[float]]:
    rows: list[list[float]] = []
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    for number, line in enumerate(lines):
        words = line.replace(",", " ").replace(";", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            rows.append([float(word) for word in words])
        except ValueError as error:
            if rows:
                raise TissueError(
                    f"{path}, line {number + 1}: {line[:60]!r} isn't numbers; mend the file"
                ) from error
    if not rows:
        raise TissueError(f"{path}: holds no points")
    return rows


def _read_ply(path: Path) -> tuple[FloatArray, FloatArray | None]:
    from trimesh.exchange.ply import load_ply  # heavy, and few who name a tissue read one

    # trimesh's readers raise whatever their parsers do.
    try:
        with path.open("rb") as file:
            loaded = load_ply(file)
    except Exception as error:
        raise TissueError(f"{path}: can't be read as points ({error})") from error
    data: Any = loaded.get("metadata", {}).get("_ply_raw", {}).get("vertex", {}).get("data")
    normals = None
    # A dict of columns from text, a structured array from binary files.
    fields = () if data is None else data if isinstance(data, dict) else data.dtype.names or ()
    if set(_NORMAL) <= set(fields):
        columns = [np.asarray(data[name], dtype=np.float64).ravel() for name in _NORMAL]
        normals = np.column_stack(columns)
    points = np.asarray(loaded.get("vertices", np.empty((0, 3))), dtype=np.float64)
    return points.reshape(-1, 3), normals
