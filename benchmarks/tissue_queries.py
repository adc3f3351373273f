"""Accuracy and speed of a prepared tissue's distance queries, against its exact surface."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.checkers import winding_numbers
from benchmarks.checkers.containment import surface_tree, to_surface
from benchmarks.checkers.mesh_query import brute_distances, brute_windings
from benchmarks.machine import row
from design.tissue import Tissue

FloatArray = NDArray[np.float64]
Row = dict[str, Any]

POINTS = 200_000
TIMED = 1_000_000
BRUTE = 40
CAPSULES = 50_000
ROUNDING_MM = 1e-9


class Exact:
    """Exact answers by the checkers' box tree."""

    def __init__(self, tissue: Tissue) -> None:
        self.triangles = tissue.surface.vertices[tissue.surface.faces]
        self.tree = surface_tree(self.triangles)
        self.sorted = np.ascontiguousarray(self.triangles[self.tree.order])
        self.corners = cKDTree(tissue.surface.vertices)

    def away(self, start: FloatArray, end: FloatArray, within: FloatArray | None = None) -> Any:
        """Distance of segments from the surface, where below ``within``."""
        # The nearest corner bounds the distance of a point; the tree's search needs a bound.
        bound = self.corners.query(start)[0] * (1 + 1e-9) + 1e-9 if within is None else within
        return to_surface(start, end, bound, self.tree, self.sorted)

    def inside(self, points: FloatArray) -> NDArray[np.bool_]:
        """Whether points are in the tissue."""
        found: NDArray[np.bool_] = winding_numbers(points, self.triangles, self.tree) > 0
        return found

    def signed(self, points: FloatArray) -> FloatArray:
        """Signed distance, negative inside."""
        away: FloatArray = self.away(points, points)
        return np.where(self.inside(points), -away, away)


def on_surface(triangles: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Points spread evenly over the surface."""
    one, two = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = np.linalg.norm(np.cross(one, two), axis=1)
    face = rng.choice(len(triangles), count, p=area / area.sum())
    weight = rng.dirichlet(np.ones(3), count)
    return np.asarray(np.einsum("ij,ijk->ik", weight, triangles[face]))


def query_rows(name: str, tissue: Tissue, prepared_s: float) -> Iterator[Row]:
    """Rows of one tissue."""
    rng = np.random.default_rng(1)
    exact, h = Exact(tissue), tissue.grid.spacing_mm
    wall, megabytes = min(tissue.thinnest_wall_mm, 1e9), tissue.grid.arrays.samples.nbytes / 1e6
    yield (
        row(f"{name}: prepared", round(prepared_s, 2), "s")
        | {"clock": "wall", "faces": len(tissue.surface.faces), "spacing_mm": round(h, 4)}
        | {"thinnest_wall_mm": round(wall, 4), "grid_mb": round(megabytes, 1)}
    )
    yield vouched(name, exact, tissue, rng)
    yield surface_row(name, exact, tissue, rng)
    yield from point_rows(name, exact, tissue, rng)
    yield capsule_row(name, exact, tissue, rng)
    yield from speed_rows(name, exact, tissue, rng)


def vouched(name: str, exact: Exact, tissue: Tissue, rng: np.random.Generator) -> Row:
    """The checkers' tree against every triangle, in NumPy."""
    low, high = tissue.bounds
    points = np.concatenate([on_surface(exact.triangles, BRUTE // 2, rng) + rng.normal(0, 0.2, 3)])
    points = np.concatenate([points, rng.uniform(low, high, (BRUTE // 2, 3))])
    error = np.abs(brute_distances(points, exact.triangles) - exact.away(points, points)).max()
    winding = np.rint(brute_windings(points, exact.triangles)) > 0
    agree = bool((winding == exact.inside(points)).all())
    return row(
        f"{name}: exact checker against brute force, {len(points)} points",
        float(error),
        "mm",
        "<= 1e-9, and inside alike",
        bool(error <= 1e-9 and agree),
    )


def surface_row(name: str, exact: Exact, tissue: Tissue, rng: np.random.Generator) -> Row:
    """The grid's reads at places of the exact surface, where the distance is 0."""
    read = np.abs(tissue.grid.distance(on_surface(exact.triangles, POINTS, rng)))
    return row(f"{name}: surface error, mean", float(read.mean()), "mm") | {
        "p99_mm": float(np.percentile(read, 99)),
        "max_mm": float(read.max()),
        "mean_of_spacing": float(read.mean() / tissue.grid.spacing_mm),
    }


def point_rows(name: str, exact: Exact, tissue: Tissue, rng: np.random.Generator) -> Iterator[Row]:
    """Points read as inside that are outside, all over the box and near the surface."""
    low, high = tissue.bounds
    h = tissue.grid.spacing_mm
    far = rng.uniform(low, high, (POINTS, 3))
    near = on_surface(exact.triangles, POINTS, rng)
    near = near + rng.uniform(-h, h, near.shape)
    for where, points in (("in its box", far), ("within a cell of the surface", near)):
        truth, read = exact.signed(points), tissue.grid.distance(points)
        false_in = (read < 0) & (truth > ROUNDING_MM)
        false_out = (read >= 0) & (truth < -ROUNDING_MM)
        deepest = float(np.where(false_in, truth, 0.0).max())
        yield (
            row(f"{name}: points falsely inside, {where}", float(false_in.mean()), "of all")
            | {"falsely_outside": float(false_out.mean()), "farthest_outside_mm": deepest}
            | {"mean_error_mm": float(np.abs(read - truth).mean())}
        )


def capsule_row(name: str, exact: Exact, tissue: Tissue, rng: np.random.Generator) -> Row:
    """Capsules near the surface judged as growth judges them, against the exact surface."""
    h = tissue.grid.spacing_mm
    start = on_surface(exact.triangles, CAPSULES, rng) + rng.normal(0, h, (CAPSULES, 3))
    end = start + rng.normal(0, 2 * h, start.shape)
    radius = rng.uniform(0.01, 0.5, CAPSULES) * h
    away = exact.away(start, end, radius)
    truth = (away >= radius - ROUNDING_MM) & exact.inside(end)
    said = tissue.grid.capsule_inside(start, end, radius)
    falsely = int((said & ~truth).sum())
    return row(
        f"{name}: capsules falsely inside, of {CAPSULES}", falsely, "", "0", falsely == 0
    ) | {"falsely_outside": int((~said & truth).sum()), "inside": int(truth.sum())}


def speed_rows(name: str, exact: Exact, tissue: Tissue, rng: np.random.Generator) -> Iterator[Row]:
    """Nanoseconds per query on one thread."""
    low, high = tissue.bounds
    points = rng.uniform(low, high, (TIMED, 3))
    some = points[: TIMED // 20]
    mine = per_query(lambda: tissue.grid.distance(points), TIMED)
    tree = per_query(lambda: exact.signed(some), len(some))
    yield row(
        f"{name}: signed distance at a point",
        round(mine, 1),
        "ns",
        peer={"name": "exact mesh query (checkers' box tree)", "value": round(tree), "unit": "ns"},
    ) | {"times_faster": round(tree / mine, 1)}
    ends = some + rng.normal(0, 3 * tissue.grid.spacing_mm, some.shape)
    radius = np.full(len(some), 0.2 * tissue.grid.spacing_mm)
    mine = per_query(lambda: tissue.grid.capsule_inside(some, ends, radius), len(some))
    tree = per_query(lambda: (exact.away(some, ends, radius), exact.inside(ends)), len(some))
    yield row(
        f"{name}: exact capsule test",
        round(mine, 1),
        "ns",
        peer={"name": "exact mesh query (checkers' box tree)", "value": round(tree), "unit": "ns"},
    ) | {"times_faster": round(tree / mine, 1)}


def per_query(ask: Callable[[], Any], count: int) -> float:
    """Best of three, after one to warm up, ns."""
    ask()
    best = np.inf
    for _ in range(3):
        begin = time.perf_counter()
        ask()
        best = min(best, time.perf_counter() - begin)
    return float(best / count * 1e9)
