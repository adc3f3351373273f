"""Rows on anatomic templates: heart and kidney, on real meshes and shapes made up here."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers import (
    murray_residual,
    near_pairs,
    outlet_flows,
    pieces_outside,
    read_network,
    read_stl,
    spread,
)
from benchmarks.checkers.anatomy import (
    above_terminals,
    kinks,
    length_beside,
    one_kind,
    outer_triangles,
    triangle_distance,
    wide_pieces,
)
from benchmarks.checkers.orders import elements_by_diameter, published_table
from benchmarks.common import DATA, Row, all_of, at_least, limited, needed, row, scratch, timed

_CLEARANCE = 0.1
_TRUNK = 0.2
"""Of the root's radius, from which on a coronary counts as a trunk."""

_GROW = """
import json, sys, time
from pathlib import Path
from design.anatomy.organs.heart import HeartAnatomy, grow_heart
from design.anatomy.organs.kidney import KidneyAnatomy, grow_kidney
from design.anatomy.curves import curved_network
from design.anatomy.organ import PRESETS
from design.network_files.csv_format import write_network_csv
from design.tissue import load_tissue
from design.units import PA_PER_MMHG
from design.vasculature import GrowthOptions
stl, organ, terminals, out = sys.argv[1:]
tissue = load_tissue(Path(stl), "mm")
preset = PRESETS[organ]
drop = preset.pressure_drop_mmhg * PA_PER_MMHG
options = GrowthOptions(terminals=int(terminals), seed=1, clearance_mm=0.1,
    murray_exponent=preset.murray_exponent, pressure_drop_pa=drop)
begin = time.process_time()
grow = {"heart": lambda *given: grow_heart(*given, HeartAnatomy(published_radii=True)),
    "kidney": lambda *given: grow_kidney(*given, KidneyAnatomy(vein="beside"))}
found = grow[organ](tissue, options)
network = curved_network(found.trees, found.kinds)
write_network_csv(Path(out), network)
known = {"cpu_s": time.process_time() - begin,
    "drop_pa": [tree.pressure_drop_pa for tree in found.trees], "murray": preset.murray_exponent}
print(json.dumps(known))
"""


def organ_rows(name: str, stl: Path, organ: str, terminals: int, folder: Path) -> Iterator[Row]:
    """Grow an organ by its template in a process of its own; yield all its rows."""
    out = folder / f"{organ}.csv"
    _, _, told = timed([sys.executable, "-c", _GROW, str(stl), organ, str(terminals), str(out)])
    known = json.loads(told.splitlines()[-1])
    net, tissue = read_network(out), read_stl(stl)
    yield row(f"{name}: growth, CPU", round(known["cpu_s"], 1), "s")
    trees = [one_kind(net, kind) for kind in np.unique(net.kind)]
    bent = sum(kinks(tree, 30.0, 0.05) for tree in trees)
    yield limited(f"{name}: kinks over 30 degrees, above 5 % of the root", bent, "", 0)
    near = near_pairs(net, _CLEARANCE, 0.1)
    yield limited(f"{name}: colliding pairs", len(near.colliding), "pairs", 0)
    outside = sum(len(pieces_outside(tree, tissue).pieces) for tree in trees)
    yield limited(f"{name}: pieces out of the tissue", outside, "", 0)
    murray = max(murray_residual(tree, known["murray"]) for tree in trees)
    yield limited(f"{name}: Murray residual", murray, "relative", 1e-9)
    # Of each kind all have one drop; arteries come first.
    drops = known["drop_pa"][:: max(1, len(known["drop_pa"]) // len(trees))]
    flow = [outlet_flows(*pair, 4e-3) for pair in zip(trees, drops, strict=False)]
    off = max(spread(one) for one in flow)
    yield limited(f"{name}: terminal flow spread", off, "relative", 1e-9)
    total = abs(flow[-1].sum() / flow[0].sum() - 1.0)
    yield limited(f"{name}: flow of the vein and of what comes in apart", total, "relative", 1e-9)
    ends = [len(tree.outlets()) for tree in trees]
    yield row(f"{name}: terminals", ends[-1], "1", str(terminals), set(ends) == {terminals})
    rows = {"heart": _heart, "kidney": _kidney}
    yield from rows[organ](name, net, tissue)


def _heart(name: str, net: Any, tissue: Any) -> Iterator[Row]:
    ostia = len(np.setdiff1d(net.node[:, 0], net.node[:, 1]))
    yield row(f"{name}: ostia", ostia, "1", "2", ostia == 2)
    wide = wide_pieces(net, _TRUNK)
    axes, walls = _shallow(net.start[wide], net.end[wide], net.radius[wide].mean(axis=1), tissue)
    measure = f"{name}: vessels above {_TRUNK:g} of the root, within 1 mm of the epicardium"
    yield at_least(f"{measure}: axes", axes, "of length", 0.8)
    yield at_least(f"{measure}: lumens", walls, "of length", 0.8)
    yield from _orders(name, net)


def _shallow(begin: Any, end: Any, radius: Any, tissue: Any) -> tuple[float, float]:
    """Shares of the length whose axis, and whose lumen, lies within 1 mm of the outer surface."""
    length = np.linalg.norm(end - begin, axis=1)
    away = triangle_distance(0.5 * (begin + end), outer_triangles(tissue))
    near = away <= 1.0, away - radius <= 1.0
    return float(length[near[0]].sum() / length.sum()), float(length[near[1]].sum() / length.sum())


def _orders(name: str, net: Any) -> Iterator[Row]:
    """Elements counted by the checker, beside the published means and standard deviations.

    Judged from the most numerous order up (below it the tree was cut off), where there are five.
    """
    table = published_table()
    wide, spread = table[:, 0], np.nan_to_num(table[:, 1])
    bounds = 0.5 * ((wide + spread)[:-1] + (wide - spread)[1:])
    ours = elements_by_diameter(net, bounds)
    most = max(ours, key=lambda one: ours[one]["elements"])
    judged = {one: of for one, of in ours.items() if one >= most and of["elements"] >= 5}
    yield at_least(f"{name}: orders judged", len(judged), "", 5)
    cells = []
    for one, of in judged.items():
        wide, wide_sd, long, long_sd, slender, slender_sd = table[one - 1]
        cells += [
            (one, "diameter", of["diameter_mm"], wide, wide_sd),
            (one, "length", of["length_mm"], long, long_sd),
            (one, "slenderness", of["length_mm"] / of["diameter_mm"], slender, slender_sd),
        ]
    known = [cell for cell in cells if np.isfinite(cell[3:]).all()]
    out = [cell for cell in known if abs(cell[2] - cell[3]) > cell[4]]
    outside = [f"{what} of order {one}: {x:.3g}, {m:.3g} ± {s:.2g}" for one, what, x, m, s in out]
    made = all_of(f"{name}: orders' figures within one sd", len(known) - len(out), len(known))
    yield made | {"outside": outside}


def _kidney(name: str, net: Any, tissue: Any) -> Iterator[Row]:
    """Yield the artery's share of length with its vein within three of its own diameters.

    Vessels that end in a terminal don't count.
    """
    artery, vein = one_kind(net, "artery"), one_kind(net, "vein")
    length, near = length_beside(artery, vein, 3.0)
    branches = above_terminals(artery)
    share = float(near[branches].sum() / length[branches].sum())
    measure = f"{name}: artery above terminals, with its vein within three diameters"
    yield at_least(measure, share, "of length", 0.7)


def ellipsoid_ventricle(out: Path, length_mm: float = 78.0, wall_mm: float = 9.0) -> Path:
    """Write a truncated ellipsoid with one cavity, open at its base."""
    import trimesh

    outer, inner = trimesh.creation.icosphere(5), trimesh.creation.icosphere(5)
    half = np.array([0.36, 0.34, 0.62]) * length_mm
    outer.apply_scale(half)
    inner.apply_scale(half - wall_mm)
    box = trimesh.creation.box(extents=(3 * length_mm,) * 3)
    box.apply_translation([0, 0, -1.5 * length_mm + 0.38 * length_mm])
    cup = trimesh.boolean.intersection([outer, box], engine="manifold")
    trimesh.boolean.difference([cup, inner], engine="manifold").export(out)
    return out


def rows(quick: bool) -> Iterator[Row]:
    """Yield organs on meshes that the templates were tuned on, and on others."""
    heart, kidney = (
        needed(DATA / f"{x}.stl") for x in ("biventricle_svv", "kidney_left_hubmap_VHM")
    )
    other = needed(DATA / "heart_ventricles_hubmap_VHM.stl")
    with scratch() as folder:
        if quick:
            yield from organ_rows("kidney 1,000", kidney, "kidney", 1000, folder)
            return
        cases = (
            ("heart", "heart", heart, 8000),
            ("another heart", "heart", other, 8000),
            ("ellipsoid ventricle", "heart", ellipsoid_ventricle(folder / "e.stl"), 8000),
            ("kidney", "kidney", kidney, 8000),
        )
        for name, organ, stl, count in cases:
            yield from organ_rows(f"{name} {count:,}", stl, organ, count, folder)
