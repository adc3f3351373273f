"""Rows on anatomic templates: heart, kidney, liver, on real meshes and shapes made up here."""

from __future__ import annotations

import json
import subprocess
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
    one_tree,
    outer_triangles,
    strahler_from_root,
    triangle_distance,
    wide_pieces,
)
from benchmarks.checkers.orders import elements_by_diameter, published_steps, published_table
from benchmarks.machine import row

Row = dict[str, Any]
_CLEARANCE = 0.1
_TRUNK = 0.2
"""Of the root's radius, from which on a coronary counts as a trunk."""

_GROW = """
import json, sys, time
from pathlib import Path
from design.anatomy.heart import HeartAnatomy, grow_heart
from design.anatomy.kidney import KidneyAnatomy, grow_kidney
from design.anatomy.liver import grow_liver
from design.anatomy.published_drop import curved_network
from design.anatomy.presets import PRESETS
from design.network_files.csv_format import write_network_csv
from design.tissue import load_tissue
from design.units import PA_PER_MMHG
from design.vasculature import GrowthOptions
from design.vasculature.treemath import tree_radii
stl, organ, terminals, out, seed = sys.argv[1:]
tissue = load_tissue(Path(stl), "mm")
preset = PRESETS[organ]
drop = preset.pressure_drop_mmhg * PA_PER_MMHG
options = GrowthOptions(terminals=int(terminals), seed=int(seed), clearance_mm=0.1,
    murray_exponent=preset.murray_exponent, pressure_drop_pa=drop)
begin = time.process_time()
grow = {"liver": grow_liver,
    "heart": lambda *given: grow_heart(*given, HeartAnatomy(published_radii=True)),
    "kidney": lambda *given: grow_kidney(*given, KidneyAnatomy(vein="beside"))}
found = grow[organ](tissue, options)
network = curved_network(found.trees, found.kinds)
write_network_csv(Path(out), network)
known = {"cpu_s": time.process_time() - begin, "notes": found.notes,
    "drop_pa": [tree.pressure_drop_pa for tree in found.trees], "murray": preset.murray_exponent,
    "trunks": [[end[one.given].tolist() for end in (one.proximal, one.distal, tree_radii(one))]
        for one in found.trees]}
print(json.dumps(known))
"""


def grown(stl: Path, organ: str, terminals: int, out: Path, seed: int = 1) -> dict[str, Any]:
    """Grow by a template in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", _GROW, str(stl), organ, str(terminals), str(out), str(seed)],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise ValueError(done.stderr.strip().splitlines()[-1])
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def anatomy_rows(
    name: str, stl: Path, organ: str, terminals: int, folder: Path, seed: int = 1
) -> Iterator[Row]:
    """All rows of one organ."""
    out = folder / f"{organ}.csv"
    known = grown(stl, organ, terminals, out, seed)
    net, tissue = read_network(out), read_stl(stl)
    yield row(f"{name}: growth, CPU", round(known["cpu_s"], 1), "s")
    trees = [one_kind(net, kind) for kind in np.unique(net.kind)]
    if organ == "liver":
        trees = [one_tree(net, number) for number in range(3)]
    bent = sum(kinks(tree, 30.0, 0.05) for tree in trees)
    yield _zero(f"{name}: kinks over 30 degrees, above 5 % of the root", bent)
    near = near_pairs(net, _CLEARANCE, 0.1)
    yield _zero(f"{name}: colliding pairs", len(near.colliding))
    outside = sum(len(pieces_outside(tree, tissue).pieces) for tree in trees)
    yield _zero(f"{name}: pieces out of the tissue", outside)
    murray = max(murray_residual(tree, known["murray"]) for tree in trees)
    yield _most(f"{name}: Murray residual", murray, 1e-9)
    # Of each kind all have one drop; arteries come first.
    drops = known["drop_pa"][:: max(1, len(known["drop_pa"]) // len(trees))]
    flow = [outlet_flows(*pair, 4e-3) for pair in zip(trees, drops, strict=False)]
    yield _most(f"{name}: terminal flow spread", max(spread(one) for one in flow), 1e-9)
    into = flow[0].sum() + (flow[1].sum() if organ == "liver" else 0.0)
    total = abs(flow[-1].sum() / into - 1.0)
    yield _most(f"{name}: flow of the vein and of what comes in apart", total, 1e-9)
    ends = [len(tree.outlets()) for tree in trees]
    yield row(f"{name}: terminals", ends[-1], "1", str(terminals), set(ends) == {terminals})
    rows = {"heart": _heart, "kidney": _kidney, "liver": _liver}
    yield from rows[organ](name, net, tissue, known)


def _heart(name: str, net: Any, tissue: Any, known: dict[str, Any]) -> Iterator[Row]:
    ostia = len(np.setdiff1d(net.node[:, 0], net.node[:, 1]))
    yield row(f"{name}: ostia", ostia, "1", "2", ostia == 2)
    wide = wide_pieces(net, _TRUNK)
    axes, walls = _shallow(net.start[wide], net.end[wide], net.radius[wide].mean(axis=1), tissue)
    measure = f"{name}: vessels above {_TRUNK:g} of the root, within 1 mm of the epicardium"
    yield row(f"{measure}: axes", axes, "of length", ">= 0.8", axes >= 0.8)
    yield row(f"{measure}: lumens", walls, "of length", ">= 0.8", walls >= 0.8)
    planned = (np.concatenate([np.array(one[k]) for one in known["trunks"]]) for k in range(3))
    axes, walls = _shallow(*planned, tissue)
    measure = f"{name}: trunks by the template's own list, within 1 mm of the epicardium"
    yield row(f"{measure}: axes", axes, "of length")
    yield row(f"{measure}: lumens", walls, "of length")
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
    yield row(
        f"{name}: orders' figures within one sd",
        len(known) - len(out),
        f"of {len(known)}",
        "all",
        not out,
    ) | {
        "outside": [
            f"{what} of order {one}: {x:.3g}, {m:.3g} ± {s:.2g}" for one, what, x, m, s in out
        ]
    }
    orders = np.array(sorted(judged))
    for what, key, turn in (
        ("branching ratio", "elements", -1.0),
        ("diameter ratio", "diameter_mm", 1.0),
        ("length ratio", "length_mm", 1.0),
    ):
        steps = published_steps(key, orders)
        slope = np.polyfit(orders, np.log([judged[n][key] for n in orders.tolist()]), 1)[0]
        value, mean, sd = (
            float(np.exp(turn * slope)),
            float(np.mean(steps)),
            float(np.std(steps, ddof=1)),
        )
        goal = f"{mean:.3g} ± {sd:.2g}"
        yield row(f"{name}: {what}", value, "1", goal, abs(value - mean) <= sd)


def _kidney(name: str, net: Any, tissue: Any, known: dict[str, Any]) -> Iterator[Row]:
    artery, vein = one_kind(net, "artery"), one_kind(net, "vein")
    capsule = outer_triangles(tissue)
    ends = artery.end[~np.isin(artery.node[:, 1], artery.node[:, 0])]
    cortex = float(triangle_distance(ends, capsule).max()) / 3  # vessels end all over the organ
    shallow, entry = 0, []
    for tree in (artery, vein):
        order = strahler_from_root(tree)
        wide = order >= order.max() - 2
        points = np.concatenate([tree.start[wide], tree.end[wide]])
        entry.append(tree.start[~np.isin(tree.node[:, 0], tree.node[:, 1])][0])
        far = np.linalg.norm(points - entry[-1], axis=1) > cortex
        shallow += int((triangle_distance(points, capsule)[far] < cortex / 3).sum())
    yield _zero(f"{name}: ends of the three widest orders in the cortex's outer third", shallow)
    away = float(triangle_distance(np.array(entry), capsule).min())
    yield row(f"{name}: entries from the outer surface", away, "mm") | {"notes": known["notes"]}
    apart = float(np.linalg.norm(entry[0] - entry[1]))
    yield row(f"{name}: vein's entry from the artery's", apart, "mm")
    yield from _beside(name, artery, vein)


def _liver(name: str, net: Any, tissue: Any, known: dict[str, Any]) -> Iterator[Row]:
    portal, artery, veins = (one_tree(net, number) for number in range(3))
    length, near = length_beside(artery, portal, 3.0)
    above = above_terminals(artery)
    share = float(near[above].sum() / length[above].sum())
    what = "artery above its terminals, with the portal vein within three diameters"
    yield row(f"{name}: {what}", share, "of length", ">= 0.7", share >= 0.7)
    length, near = length_beside(veins, portal, 3.0)
    wide = strahler_from_root(veins) >= strahler_from_root(veins).max() - 2
    share = float(near[wide].sum() / length[wide].sum())
    what = "hepatic veins' three widest orders, with the portal vein within three diameters"
    yield row(f"{name}: {what}", share, "of length") | {"notes": known["notes"]}


def _beside(name: str, artery: Any, vein: Any) -> Iterator[Row]:
    """Shares of length with the other within three of its own diameters, axis from axis.

    The bar is held against all of the artery but the vessels that end in a terminal.
    """
    for what, one, two in (("artery", artery, vein), ("vein", vein, artery)):
        length, near = length_beside(one, two, 3.0)
        order, branches = strahler_from_root(one), above_terminals(one)
        for part, mine in (
            ("above terminals", branches),
            ("three widest orders", order >= order.max() - 2),
            ("terminals", ~branches),
        ):
            share = float(near[mine].sum() / length[mine].sum())
            judged = what == "artery" and part == "above terminals"
            yield row(
                f"{name}: {what}, {part}: length within three diameters of the other",
                share,
                "of length",
                ">= 0.7" if judged else "",
                share >= 0.7 if judged else None,
            )


def _zero(name: str, count: int) -> Row:
    return row(name, count, "1", "0", count == 0)


def _most(name: str, value: float, limit: float) -> Row:
    return row(name, float(value), "relative", f"< {limit:g}", bool(value < limit))


def turned_scaled(stl: Path, out: Path, scale: float) -> Path:
    """The mesh turned, scaled and cut finer, as a file."""
    import trimesh

    mesh = trimesh.load(stl)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(1.1, [1, 2, -1]))
    mesh.apply_scale(scale)
    mesh.export(out)
    return out


def ellipsoid_ventricle(out: Path, length_mm: float = 78.0, wall_mm: float = 9.0) -> Path:
    """A truncated ellipsoid with one cavity, open at its base."""
    import trimesh

    outer = trimesh.creation.icosphere(5)
    inner = trimesh.creation.icosphere(5)
    half = np.array([0.36, 0.34, 0.62]) * length_mm
    outer.apply_scale(half)
    inner.apply_scale(half - wall_mm)
    box = trimesh.creation.box(extents=(3 * length_mm,) * 3)
    box.apply_translation([0, 0, -1.5 * length_mm + 0.38 * length_mm])
    cup = trimesh.boolean.intersection([outer, box], engine="manifold")
    trimesh.boolean.difference([cup, inner], engine="manifold").export(out)
    return out


def liver_phantom(out: Path) -> Path:
    """The shipped phantom of a liver, 150 mm wide, as a file."""
    import trimesh

    from design.tissue import liver

    made = liver(150.0)
    trimesh.Trimesh(made.vertices, made.faces).export(out)
    return out


def anatomy_jobs(data: Path, folder: Path) -> Iterator[tuple[str, Any]]:
    """Organs with their names: meshes the templates were tuned on, and others."""
    heart, kidney = data / "biventricle_svv.stl", data / "kidney_left_hubmap_VHM.stl"
    other = data / "heart_ventricles_hubmap_VHM.stl"
    cases = (
        ("anatomy: heart 8,000", "heart", lambda: heart),
        ("anatomy: another heart 8,000", "heart", lambda: other),
        (
            "anatomy: ellipsoid ventricle 8,000",
            "heart",
            lambda: ellipsoid_ventricle(folder / "e.stl"),
        ),
        ("anatomy: kidney 2,000", "kidney", lambda: kidney),
        ("anatomy: kidney 8,000", "kidney", lambda: kidney),
        ("anatomy: liver phantom 1,000", "liver", lambda: liver_phantom(folder / "l.stl")),
        (
            "anatomy: kidney turned, 0.7 as large, 1,000",
            "kidney",
            lambda: turned_scaled(kidney, folder / "k.stl", 0.7),
        ),
    )
    for name, organ, stl in cases:
        count = int(name.rsplit(" ", 1)[-1].replace(",", ""))
        yield name, lambda n=name, o=organ, s=stl, c=count: anatomy_rows(n, s(), o, c, folder)
