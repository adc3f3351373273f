"""A scanned organ's solids by `printctl design`: CPU, memory, files checked from outside."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import trimesh
from manifold3d import Error, Manifold, Mesh

from benchmarks.checkers.crossing_triangles import crossing_triangles
from benchmarks.checkers.networks import Pieces, read_network
from benchmarks.checkers.solid_file import (
    capsule_union_volume,
    check_file,
    facet_deviations,
    read_corners,
)
from benchmarks.common import DATA, Row, limited, needed, printctl, row, timed

SHARE: Final = 0.05
"""Of a vessel's radius: how far 99 % of its surface may lie off (docs/solids.md)."""

_RECIPE = """schema: 1
name: kidney
seed: 1
tissue: {{mesh: {mesh}, unit: mm}}
vasculature: {{grow: tree, terminals: {terminals}{curves}}}
flow: {{viscosity_mpa_s: 4, inlet_flow_ml_min: 10}}
"""


def rows(quick: bool) -> Iterator[Row]:
    """Yield kidneys of 1,000 terminals, unless quick curved and of 8,000, too."""
    mesh = needed(DATA / "kidney_left_hubmap_VHM.stl")
    cases = ((1_000, False, 15.0), (1_000, True, 30.0), (8_000, False, 90.0))
    for terminals, curved, seconds in cases[: 1 if quick else None]:
        with tempfile.TemporaryDirectory() as scratch:
            yield from _organ(mesh, terminals, curved, seconds, Path(scratch))


def _organ(mesh: Path, terminals: int, curved: bool, seconds: float, folder: Path) -> Iterator[Row]:
    name = f"kidney, {terminals:,} terminals" + (", curved" if curved else "")
    recipe, made = folder / "kidney.yaml", folder / "design"
    curves = ", curves: true" if curved else ""
    recipe.write_text(_RECIPE.format(mesh=mesh, terminals=terminals, curves=curves))
    cpu, memory, _ = timed(printctl("design", recipe, "--out", made))
    yield limited(f"{name}: recipe to all files, CPU", cpu, "s", seconds)
    yield limited(f"{name}: peak memory", memory / 1e3, "GB", 4.0)
    pieces = read_network(made / "network.csv")
    for file in ("lumen.stl", "solid.stl", "solid.3mf"):
        yield from _file_rows(f"{name}, {file}", made / file)
    yield from _lumen_rows(f"{name}, lumen.stl", made / "lumen.stl", pieces)


def _file_rows(name: str, path: Path) -> Iterator[Row]:
    found, others = check_file(path), read_elsewhere(path)
    good = found.closed and (found.bodies, found.handles) == (1, 0) and all(others.values())
    yield row(f"{name}: read back", float(good), "valid", "closed, oriented, 1 body", good) | {
        "triangles": found.triangles,
        "megabytes": round(path.stat().st_size / 1e6, 1),
        "by": {"own reader": found.closed} | others,
    }
    if path.suffix == ".stl":
        crossing = len(crossing_triangles(read_corners(path)[0]))
        yield row(f"{name}: pairs of triangles that cross", crossing, "", "0", crossing == 0)


def _lumen_rows(name: str, path: Path, pieces: Pieces) -> Iterator[Row]:
    exact, error = capsule_union_volume(pieces.start, pieces.end, *pieces.radius.T)
    off = check_file(path).volume / exact - 1.0
    yield row(
        f"{name}: volume over the exact union's", round(off, 5), "", "within 0.01", abs(off) <= 0.01
    ) | {"standard_error": round(error / exact, 6)}
    gap, share = facet_deviations(read_corners(path)[0], pieces)
    most, usual = float(np.abs(share).max()), float(np.percentile(np.abs(share), 99))
    measure = f"{name}: distance of facets from the exact tubes, of their radius"
    yield row(f"{measure}, 99 %", round(usual, 4), "", f"<= {SHARE:g}", usual <= SHARE)
    yield row(f"{measure}, greatest (seams: no bound)", round(most, 4), "") | {
        "beyond": round(float(share.max()), 4),
        "within": round(float(share.min()), 4),
        "points_beyond_a_tenth": round(float(np.mean(np.abs(share) > 0.1)), 5),
        "greatest_um": round(1e3 * float(np.abs(gap).max()), 2),
    }


def read_elsewhere(path: Path) -> dict[str, bool]:
    """Return whether trimesh and manifold3d call the file a closed solid."""
    mesh = trimesh.load_mesh(path)
    mesh = mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
    mesh.merge_vertices(digits_vertex=12)
    sound = bool(mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0)
    solid = Manifold(Mesh(np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.uint32)))
    whole = solid.status() == Error.NoError and not solid.is_empty()
    return {"trimesh": sound, "manifold3d": whole}
