"""Regions of a real cortex supplied: the paper's supplementary tables 4 and 5.

The cortex is fsaverage5, whose surfaces nilearn ships: 100 regions of each hemisphere, by the
seed that is nearest along the middle of the cortex, cut between the white and the pial surface.
nilearn's files are read and none of its code runs. Networks are grown by the Python interface of
docs/python.md and judged from their files by the checkers.
"""

from __future__ import annotations

import gzip
import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import islice
from pathlib import Path

import nibabel
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from benchmarks.checkers import (
    enclosed_volume,
    murray_residual,
    near_pairs,
    outlet_flows,
    pieces_outside,
    read_network,
    read_stl,
    spread,
    write_stl,
)
from benchmarks.checkers.crossing_triangles import crossing_triangles
from benchmarks.common import Row, SkippedError, at_least, limited, row, scratch
from design import GrowthOptions, grow_tree, load_tissue, tree_to_network, write_network
from design.errors import DesignError
from design.network import VesselKind

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SEEDS = 100
"""Regions of a hemisphere."""

MIN_CORTEX_MM = 0.5
"""Where the surfaces are nearer there is no cortex: the wall between the hemispheres."""

MAX_FOLD_RAD = np.radians(170.0)
"""Angle between normals of faces that meet, above which the cut has folded its rim to a blade."""

LARGEST = 20
CLEARANCE_RATIO = 0.1


@dataclass(frozen=True)
class Region:
    """A closed piece of cortex: its STL, how many faces of the cortex, how many left out."""

    name: str
    stl: Path
    volume_mm3: float
    left_out: int
    trouble: str


def cut_regions(data: Path, folder: Path) -> Iterator[Region]:
    """Cut both hemispheres into regions, each written as an STL."""
    for side, code in (("left", 1), ("right", 2)):
        pial, faces = _surface(data / f"pial_{side}.gii.gz")
        white, _ = _surface(data / f"white_{side}.gii.gz")
        thick = np.linalg.norm(pial - white, axis=1) > MIN_CORTEX_MM
        faces = faces[thick[faces].all(axis=1)]
        own = _nearest_seed(0.5 * (pial + white), faces, np.random.default_rng(code))
        for number, seed in enumerate(np.unique(own)):
            patch = faces[own == seed]
            corners, kept = _solid(patch, pial, white)
            stl = folder / f"{side}_{number}.stl"
            write_stl(stl, corners)
            volume, left_out = enclosed_volume(corners), len(patch) - kept
            yield Region(f"{side} {number}", stl, volume, left_out, _not_closed(stl))


def _surface(path: Path) -> tuple[FloatArray, IntArray]:
    points, faces = nibabel.GiftiImage.from_bytes(gzip.decompress(path.read_bytes())).darrays
    return points.data.astype(np.float64), faces.data.astype(np.int64)


def _nearest_seed(middle: FloatArray, faces: IntArray, rng: np.random.Generator) -> IntArray:
    """Seed that most corners of each face are nearest to along the edges, (f,)."""
    edges = np.unique(np.sort(_edges(faces), axis=1), axis=0)
    length = np.linalg.norm(middle[edges[:, 0]] - middle[edges[:, 1]], axis=1)
    graph = coo_matrix((length, tuple(edges.T)), shape=2 * (len(middle),)).tocsr()
    seeds = rng.choice(np.unique(faces), SEEDS, replace=False)
    nearest = dijkstra(
        graph, directed=False, indices=seeds, return_predecessors=True, min_only=True
    )[2][faces].astype(np.int64)
    a, b, c = nearest.T
    most: IntArray = np.where(b == c, b, a)
    return most


def _edges(faces: IntArray) -> IntArray:
    """(3 f, 2), face by face in three runs."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _solid(patch: IntArray, pial: FloatArray, white: FloatArray) -> tuple[FloatArray, int]:
    """Close a patch between its surfaces; corners (n, 3, 3), and how many faces it kept.

    Faces are left out whose columns would cross another's, as those of two banks may, or fold
    their rim to a blade.
    """
    while True:
        patch, rim = _sheet(patch)
        used = np.unique(patch)
        count = len(used)
        top, (one, two) = np.searchsorted(used, patch), np.searchsorted(used, rim).T
        lower, upper = (two, one, one + count), (two, one + count, two + count)
        faces = np.concatenate(
            [top, top[:, ::-1] + count, np.column_stack(lower), np.column_stack(upper)]
        )
        points = np.concatenate([pial[used], white[used]]).astype(np.float32).astype(float)
        corners, mesh = points[faces], trimesh.Trimesh(points, faces, process=False)
        folded = mesh.face_adjacency[mesh.face_adjacency_angles > MAX_FOLD_RAD]
        wrong = np.union1d(crossing_triangles(corners), folded)
        if len(wrong) == 0:
            return corners, len(patch)
        patch = patch[np.isin(top, faces[wrong] % count).sum(axis=1) < 2]


def _sheet(patch: IntArray) -> tuple[IntArray, IntArray]:
    """Largest part of a patch whose rim passes no corner twice; its faces and rim (r, 2)."""
    while True:
        edges, face = _edges(patch), np.tile(np.arange(len(patch)), 3)
        name = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)[1].ravel()
        order = np.argsort(name, kind="stable")
        pairs = order[np.flatnonzero(np.diff(name[order]) == 0)[:, None] + [0, 1]]
        links = coo_matrix((np.ones(len(pairs)), tuple(face[pairs].T)), shape=2 * (len(patch),))
        part = connected_components(links, directed=False)[1]
        rim = edges[np.bincount(name)[name] == 1]
        corner, passed = np.unique(rim[:, 0], return_counts=True)
        if part.any():
            patch = patch[part == np.bincount(part).argmax()]
        elif passed.max() > 1:
            patch = patch[~np.isin(patch, corner[passed > 1]).any(axis=1)]
        else:
            return patch, rim


def _not_closed(stl: Path) -> str:
    """What trimesh and the checker of crossing faces find wrong in a region, or nothing."""
    mesh, crossing = trimesh.load(stl), len(crossing_triangles(read_stl(stl)))
    sound = mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    if sound and mesh.body_count == 1 and not crossing:
        return ""
    return f"watertight {mesh.is_watertight}, {mesh.body_count} bodies, {crossing} crossings"


@dataclass(frozen=True)
class Supply:
    """A region's growth: the product's refusal, what the checkers hold against it, its CPU s."""

    name: str
    refused: str = ""
    wrong: str = ""
    cpu_s: float = np.nan


def supply(region: Region, terminals: int) -> Supply:
    """Grow a tree in a region as docs/python.md does, and have its file judged."""
    options = GrowthOptions(terminals=terminals, seed=1, root_at_top=True)
    out, begun = region.stl.with_suffix(".csv"), time.process_time()
    try:
        tree = grow_tree(load_tissue(region.stl, "mm"), options)
        write_network(out, tree_to_network(tree, VesselKind.ARTERY))
    except DesignError as error:
        return Supply(region.name, refused=str(error))
    cpu_s, net = time.process_time() - begun, read_network(out)
    flows = spread(outlet_flows(net, options.pressure_drop_pa, options.viscosity_pa_s))
    counts = {
        "terminals missing": terminals - len(net.outlets()),
        "inlets too many": len(net.inlets()) - 1,
        "pieces outside": len(pieces_outside(net, read_stl(region.stl)).pieces),
        "colliding pairs": len(near_pairs(net, clearance_ratio=CLEARANCE_RATIO).colliding),
        "unequal flows": int(flows >= 1e-9),
        "Murray's law broken": int(murray_residual(net) >= 1e-9),
    }
    wrong = ", ".join(f"{count} {what}" for what, count in counts.items() if count)
    return Supply(region.name, "", wrong, cpu_s)


def rows(quick: bool) -> Iterator[Row]:
    """Yield 1,000 terminals in each region, 8,000 in the largest twenty; quick: five, one."""
    nilearn = find_spec("nilearn")
    if nilearn is None or nilearn.origin is None:
        raise SkippedError("needs nilearn beside printctl (pip install --no-deps nilearn)")
    data = Path(nilearn.origin).parent / "datasets" / "data" / "fsaverage5"
    with scratch() as folder:
        cut = list(islice(cut_regions(data, folder), 5 if quick else None))
        troubles = [f"{one.name}: {one.trouble}" for one in cut if one.trouble]
        made = limited("regions: solids that aren't closed", len(troubles), f"of {len(cut)}", 0)
        left_out = {"faces_left_out": sum(one.left_out for one in cut), "troubles": troubles}
        yield made | left_out
        supply(cut[0], 100)  # kernels are loaded from now on
        yield from _supplied("regions, 1,000 terminals", cut, 1000, len(cut) * 99 // 100)
        largest = sorted(cut, key=lambda one: -one.volume_mm3)[: 1 if quick else LARGEST]
        yield from _supplied("largest regions, 8,000", largest, 8000, len(largest))


def _supplied(name: str, cut: list[Region], terminals: int, least: int) -> Iterator[Row]:
    made = [supply(one, terminals) for one in cut]
    refused = [f"{one.name}: {one.refused}" for one in made if one.refused]
    wrong = [f"{one.name}: {one.wrong}" for one in made if one.wrong]
    count = len(made) - len(refused) - len(wrong)
    supplied = at_least(f"{name}: supplied", count, f"of {len(made)}", least)
    yield supplied | {"refused": refused, "wrong": wrong}
    cpu = np.array([one.cpu_s for one in made])
    median, most = float(np.nanmedian(cpu)), float(np.nanmax(cpu))
    yield row(f"{name}: STL to network.csv, median", median, "CPU s") | {"greatest": most}
