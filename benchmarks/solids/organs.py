"""A scanned organ's solids by `printctl design`: CPU, memory, files checked from outside."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh
from manifold3d import Error, Manifold, Mesh

from benchmarks.checkers.crossing_triangles import crossing_triangles
from benchmarks.checkers.meshes import enclosed_volume, read_stl
from benchmarks.checkers.networks import read_network
from benchmarks.checkers.solid_file import capsule_union_volume, facet_deviations
from benchmarks.common import DATA, Row, limited, needed, printctl, row, scratch, timed

SHARE = 0.05
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
    cases = ((1_000, False, 9.0), (1_000, True, 30.0), (8_000, False, 90.0))
    for terminals, curved, seconds in cases[: 1 if quick else None]:
        with scratch() as folder:
            yield from _organ(mesh, terminals, curved, seconds, folder)
    if not quick:
        with scratch() as folder:
            yield _network(mesh, 8_000, 4.0, folder)


def _network(mesh: Path, terminals: int, seconds: float, folder: Path) -> Row:
    recipe = folder / "kidney.yaml"
    recipe.write_text(_RECIPE.format(mesh=mesh, terminals=terminals, curves=""))
    design = printctl("design", recipe, "--out", folder / "design", "--until", "vasculature")
    name = f"kidney, {terminals:,} terminals: recipe to network, whole process, CPU"
    return limited(name, timed(design)[0], "s", seconds)


def _organ(mesh: Path, terminals: int, curved: bool, seconds: float, folder: Path) -> Iterator[Row]:
    name = f"kidney, {terminals:,} terminals" + (", curved" if curved else "")
    recipe, made = folder / "kidney.yaml", folder / "design"
    curves = ", curves: true" if curved else ""
    recipe.write_text(_RECIPE.format(mesh=mesh, terminals=terminals, curves=curves))
    cpu, memory, _ = timed(printctl("design", recipe, "--out", made))
    yield limited(f"{name}: recipe to all files, CPU", cpu, "s", seconds)
    yield limited(f"{name}: peak memory", memory / 1e3, "GB", 4.0)
    for file in ("lumen.stl", "solid.stl", "solid.3mf"):
        by = readers_of(made / file)
        good = all(by.values())
        yield row(f"{name}, {file}: read back", float(good), "valid", "closed, 1 body", good) | by
        if file.endswith(".stl"):
            crossing = len(crossing_triangles(read_stl(made / file)))
            yield limited(f"{name}, {file}: pairs of triangles that cross", crossing, "", 0)
    corners, net = read_stl(made / "lumen.stl"), read_network(made / "network.csv")
    exact, error = capsule_union_volume(net)
    off = enclosed_volume(corners) / exact - 1.0
    measure = f"{name}, lumen.stl: volume over the exact union's"
    made_row = row(measure, round(off, 5), "", "within 0.01", abs(off) <= 0.01)
    yield made_row | {"standard_error": round(error / exact, 6)}
    share = np.abs(facet_deviations(corners, net))
    measure = f"{name}, lumen.stl: distance of facets from the exact tubes, of their radius, 99 %"
    yield limited(measure, float(np.percentile(share, 99)), "", SHARE) | {
        "greatest (seams: no bound)": float(share.max())
    }


def readers_of(path: Path) -> dict[str, bool]:
    """Return whether trimesh and manifold3d call the file one closed, oriented solid."""
    mesh = trimesh.load_mesh(path)
    mesh = mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
    mesh.merge_vertices(digits_vertex=12)
    sound = mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    solid = Manifold(Mesh(np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.uint32)))
    one = solid.status() == Error.NoError and len(solid.decompose()) == 1 and solid.genus() == 0
    return {"trimesh": bool(sound and mesh.body_count == 1), "manifold3d": one}
