"""Benchmark of unions of grown networks, sharp and smooth, judged on the files read back.

Each union is made in a process of its own, after one of a small network so that compiled kernels
are loaded. Time is of the whole call from network to solid; writing is beside it. The checker
(`benchmarks.checkers.solid_file`) shares nothing with the maker; trimesh, manifold3d and, where it
is installed, lib3mf read the same files.

Volumes are those of the files as the checker reads them, fillets included, against the sharp
union of capsules by Monte-Carlo.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers import read_network
from benchmarks.checkers.crossing_triangles import crossing_triangles
from benchmarks.checkers.solid_file import capsule_union_volume, check_file, read_corners
from benchmarks.machine import peak_mb, print_rows, row
from benchmarks.vasculature_runs import run_module
from design.network import VesselKind, VesselNetwork
from design.network_files.csv_format import read_network_csv, write_network_csv
from design.solids import lumen_solid, write_3mf, write_stl
from design.tissue import block, tissue_from_surface
from design.vasculature import GrowthOptions, grow_tree, tree_to_network

Row = dict[str, Any]

PEER = {"name": "manifold3d, batch of capsules", "watertight_when_read_back": False}
CASES = (
    # terminals, side of the block (mm), fillet ratio, seconds, GB, share of volume
    (500, 34.2, 0.0, 4.0, 4.0, 0.002, 3.8),
    (500, 34.2, 0.5, 10.0, 2.0, 0.005, None),
    (10_000, 60.0, 0.0, 60.0, 4.0, 0.002, 48.0),
)
CROSSINGS_UP_TO = 2000
"""Segments; the checker's search takes 15 s for 600,000 triangles."""

TRIMESH_3MF_GB = 16.0
"""That trimesh takes to read a 3MF of 7.3 million triangles (19,999 segments): 15.2 GB."""


def rows(quick: bool = False) -> Iterator[Row]:
    """A row a promise; ``quick`` leaves 20,000 segments out."""
    with tempfile.TemporaryDirectory() as folder:
        for terminals, side, fillet, *goals in CASES:
            if quick and terminals > 1000:
                continue
            path = Path(folder) / f"{terminals}.csv"
            if not path.exists():
                _grow(path, terminals, side)
            words = ["--network", str(path), "--fillet", str(fillet), "--out", folder]
            kind = "smooth" if fillet else "sharp"
            name = f"{kind} union, {2 * terminals - 1:,} segments"
            yield from _rows(name, run_module(name, "benchmarks.solids_union", words), path, goals)


def _grow(path: Path, terminals: int, side: float) -> None:
    shape = block((side, side, side))
    tissue = tissue_from_surface(shape.vertices, shape.faces)
    tree = grow_tree(tissue, GrowthOptions(terminals=terminals, seed=1))
    write_network_csv(path, tree_to_network(tree, VesselKind.ARTERY))


def _rows(name: str, run: Row, path: Path, goals: list[Any]) -> Iterator[Row]:
    seconds, gigabytes, share, peer = goals
    value = round(run["seconds"], 2)
    made = row(f"{name}: time", value, "s", f"<= {seconds:g}", value <= seconds)
    if peer:
        made["peer"] = PEER | {"value": peer}
    yield made | {"clock": "wall", "cpu_s": round(run["cpu_s"], 2), "triangles": run["triangles"]}
    peak = round(run["peak_mb"] / 1e3, 2)
    yield row(f"{name}: peak memory", peak, "GB", f"<= {gigabytes:g}", peak <= gigabytes)
    pieces = read_network(path)
    genus = pieces.count - pieces.node_count + 1  # of a connected graph: its independent loops
    volume = 0.0
    for suffix in ("stl", "3mf"):
        file = Path(run["stem"] + "." + suffix)
        found, others = check_file(file), read_elsewhere(file)
        volume = found.volume
        good = found.closed and (found.bodies, found.handles) == (1, genus) and all(others.values())
        told = f"closed, oriented, 1 body, genus {genus}"
        yield row(f"{name}: {suffix} read back", float(good), "valid", told, good) | {
            "handles": found.handles,
            "bodies": found.bodies,
            "by": {"own reader": found.closed} | others,
        }
    if pieces.count <= CROSSINGS_UP_TO:
        crossing = len(crossing_triangles(read_corners(Path(run["stem"] + ".stl"))[0]))
        yield row(f"{name}: triangles of the STL that cross", crossing, "", "0", crossing == 0)
    exact, error = capsule_union_volume(pieces.start, pieces.end, *pieces.radius.T)
    off = volume / exact - 1
    measure = f"{name}: volume of the file, fillets and all, from the exact union without"
    yield row(measure, round(off, 6), "", f"within {share:g}", abs(off) <= share) | {
        "standard_error": round(error / exact, 6)
    }


def read_elsewhere(path: Path) -> dict[str, bool]:
    """Whether other readers call the file a closed solid."""
    import trimesh
    from manifold3d import Error, Manifold, Mesh

    if path.suffix == ".3mf" and path.stat().st_size > 5e7 and _free_gb() < TRIMESH_3MF_GB:
        print(f"{path.name}: trimesh needs {TRIMESH_3MF_GB:g} GB, not read", file=sys.stderr)
        return _lib3mf(path)
    mesh = trimesh.load_mesh(path)
    mesh = mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
    mesh.merge_vertices(digits_vertex=12)
    found = {"trimesh": bool(mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0)}
    solid = Manifold(Mesh(np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.uint32)))
    found["manifold3d"] = solid.status() == Error.NoError and not solid.is_empty()
    if path.suffix == ".3mf":
        found |= _lib3mf(path)
    return found


def _free_gb() -> float:
    """Memory that is free, where the system says it."""
    meminfo = Path("/proc/meminfo")
    if not meminfo.exists():
        return 0.0
    lines = dict(line.split(":") for line in meminfo.read_text().splitlines())
    return int(lines["MemAvailable"].split()[0]) / 1e6


def _lib3mf(path: Path) -> dict[str, bool]:
    try:
        import lib3mf
    except ImportError:
        return {}
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(path))
    meshes = model.GetMeshObjects()
    good = meshes.Count() > 0 and reader.GetWarningCount() == 0
    while meshes.MoveNext():
        good = good and meshes.GetCurrentMeshObject().IsManifoldAndOriented()
    return {"lib3mf": good}


def _warm(fillet: float) -> None:
    ends = np.array([[0, 1], [1, 2], [1, 3]])
    nodes = np.array([[0.0, 0, 0], [5, 0, 0], [9, 3, 0], [9, -3, 1]])
    radius, kind = np.full(3, 0.4), np.zeros(3, np.int64)
    lumen_solid(VesselNetwork.from_segments(nodes, ends, radius, kind, kind), fillet_ratio=fillet)


def main() -> None:
    """One union in this process, or with no network all rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--network", type=Path)
    parser.add_argument("--fillet", type=float, default=0.0)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--quick", action="store_true")
    asked = parser.parse_args()
    if asked.network is None:
        print_rows(list(rows(asked.quick)))
        return
    network = read_network_csv(asked.network, "mm")
    _warm(asked.fillet)
    begin, cpu = time.perf_counter(), time.process_time()
    solid = lumen_solid(network, fillet_ratio=asked.fillet)
    found: Row = {"seconds": time.perf_counter() - begin, "cpu_s": time.process_time() - cpu}
    found |= {"peak_mb": peak_mb(), "triangles": len(solid.faces)}
    stem = asked.out / f"{asked.network.stem}_{asked.fillet:g}"
    write_stl(stem.with_name(stem.name + ".stl"), solid)
    write_3mf(stem.with_name(stem.name + ".3mf"), solid)
    found |= {"stem": str(stem)}
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()
