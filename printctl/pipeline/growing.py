"""Grow the vessels of a recipe: a tree, an organ's trees, loops or a forest."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from design.anatomy.cortex import CortexAnatomy, grow_cortex
from design.anatomy.heart import HeartAnatomy, grow_heart
from design.anatomy.kidney import KidneyAnatomy, grow_kidney
from design.anatomy.liver import LiverAnatomy, grow_liver
from design.anatomy.organ import PRESETS, AnatomicTrees, grow_or_advise, uneven_notes
from design.errors import LEAST_IN_CORTEX, LEAST_TERMINALS
from design.hemodynamics import FlowConditions, balance
from design.network import VesselKind, VesselNetwork
from design.network_files.by_suffix import read_network, read_with_notes
from design.tissue import Tissue
from design.units import PA_PER_MMHG
from design.vasculature import (
    ClosedLoops,
    DepthPenalty,
    GrownParts,
    GrowthOptions,
    GrowthStage,
    Inlet,
    JoinedTrees,
    LoopOptions,
    PartSupply,
    RootSpec,
    VesselTree,
    check_supply,
    close_loops,
    grow_forest,
    grow_parts,
    grow_printable,
    grow_tree,
    join_forest,
    terminals_of,
)
from design.vasculature.growth.territories import Surroundings
from design.vasculature.growth.trunk import trunk_of
from kernels.arrays import FloatArray
from printctl.errors import RecipeError
from printctl.pipeline.context import RunContext
from printctl.pipeline.printability import printability
from printctl.recipe.anatomy import AnatomyPart
from printctl.recipe.forest import Forest, GrownTrees, TreePart
from printctl.recipe.growth import ClosedLoop, GrownNetwork, Growth, PenaltyPart, StagePart

# Convert a recipe's growth section to growth options, and read the files it names.


def growth_options(part: Growth, seed: int, recipe_folder: Path = Path()) -> GrowthOptions:
    """The recipe's words in the design's units; paths are relative to the recipe.

    Raises
    ------
    RecipeError
        When the file of terminals can't be read.
    """
    points: FloatArray | None = None
    flows: FloatArray | None = None
    stages: tuple[GrowthStage, ...] = ()
    terminals = part.terminals
    if isinstance(part, GrownNetwork):
        if part.terminal_points is not None:
            points, flows = read_terminals(recipe_folder / part.terminal_points)
            terminals = len(points)
        stages = tuple(_stage(stage) for stage in part.stages)
        terminals = stages[-1].terminals if stages else terminals
    return GrowthOptions(
        terminals=terminals or 0,
        seed=seed,
        murray_exponent=part.murray_exponent,
        length_exponent=part.length_exponent,
        radius_exponent=part.radius_exponent,
        viscosity_pa_s=part.viscosity_mpa_s * 1e-3,
        viscosity_law=part.viscosity_law,
        haematocrit=part.haematocrit,
        pressure_drop_pa=part.pressure_drop_mmhg * PA_PER_MMHG,
        perfusion_ml_min_per_ml=part.perfusion_ml_min_per_ml,
        smallest_radius_mm=part.smallest_diameter_mm / 2 if part.smallest_diameter_mm else None,
        clearance_mm=part.clearance_mm,
        clearance_ratio=part.clearance_ratio,
        length_to_radius=part.length_to_radius,
        branch_angle_degrees=part.branch_angle_degrees,
        turn_angle_degrees=part.turn_angle_degrees,
        flow_ratio=part.flow_ratio,
        penalty=_penalty(part.penalty),
        follow_demand=part.follow_demand,
        terminal_flow=part.terminal_flow if isinstance(part, GrownNetwork) else "equal",
        terminal_points_mm=points,
        terminal_flows=flows,
        root_point_mm=part.root_mm,
        root_direction=part.root_direction,
        root_candidates=(
            part.root_candidates if isinstance(part, GrownNetwork) and part.root == "search" else 0
        ),
        stages=stages,
    )


def _penalty(part: PenaltyPart | None) -> DepthPenalty | None:
    return None if part is None else DepthPenalty(part.depth_mm, part.factor)


def _stage(part: StagePart) -> GrowthStage:
    return GrowthStage(
        terminals=part.terminals,
        clearance_mm=part.clearance_mm,
        length_to_radius=part.length_to_radius,
        follow_demand=part.follow_demand,
        branch_angle_degrees=part.branch_angle_degrees,
        turn_angle_degrees=part.turn_angle_degrees,
        flow_ratio=part.flow_ratio,
        penalty=_penalty(part.penalty),
    )


def loop_options(part: ClosedLoop | Forest, seed: int) -> LoopOptions:
    """Options of the connections, with the trees' own clearance and smallest lumen."""
    own = part.connections
    thinnest = part.smallest_diameter_mm
    return LoopOptions(
        seed=seed,
        clearance_mm=part.clearance_mm,
        clearance_ratio=part.clearance_ratio,
        bend_to_radius=own.bend_to_radius,
        kink_degrees=own.kink_degrees,
        radius_ratio=own.radius_ratio,
        smallest_radius_mm=None if thinnest is None else thinnest / 2,
        prune_part=own.most_pruned_percent / 100.0,
        weight_length=own.length_weight,
        weight_tortuosity=own.tortuosity_weight,
        weight_clearance=own.clearance_weight,
        weight_volume=own.volume_weight,
    )


def read_trunk(part: GrownNetwork, recipe_folder: Path) -> VesselNetwork | None:
    """The artery that growth goes on from; None without one."""
    if part.trunk is None:
        return None
    return read_network(recipe_folder / part.trunk, part.trunk_unit)


def read_terminals(path: Path) -> tuple[FloatArray, FloatArray | None]:
    """Points (n, 3), mm, and flows (n,) where the file has them.

    Raises
    ------
    RecipeError
        Without the columns x_mm, y_mm and z_mm, or with what isn't a number; with the line.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file, skipinitialspace=True)
            names = [name.strip() for name in rows.fieldnames or ()]
            rows.fieldnames = names
            wanted = ["x_mm", "y_mm", "z_mm", *(["flow"] if "flow" in names else [])]
            if not set(wanted) <= set(names):
                raise RecipeError(
                    f"{path}: columns are {', '.join(names) or 'missing'}; give x_mm, y_mm, z_mm "
                    "and, if wanted, flow in the first line"
                )
            table = [(rows.line_num, _numbers(path, rows.line_num, row, wanted)) for row in rows]
    except (OSError, UnicodeDecodeError) as exc:
        raise RecipeError(f"terminal_points {path} can't be read: {exc}") from exc
    _refuse_twins(path, table)
    values = np.array([row for _, row in table], dtype=np.float64).reshape(-1, len(wanted))
    return values[:, :3], values[:, 3] if len(wanted) == 4 else None


def _numbers(path: Path, line: int, row: dict[str, str], wanted: list[str]) -> list[float]:
    texts = [row.get(name) for name in wanted]
    try:
        numbers = [float(row[name]) for name in wanted]
    except (TypeError, ValueError) as exc:
        raise RecipeError(
            f"{path}, line {line}: {texts} aren't numbers; mend or remove it"
        ) from exc
    if not np.isfinite(numbers).all():
        raise RecipeError(f"{path}, line {line}: {texts} aren't all finite; mend or remove it")
    if len(numbers) == 4 and not numbers[3] > 0.0:
        raise RecipeError(f"{path}, line {line}: flow is {numbers[3]:g}; give one above 0")
    return numbers


def _refuse_twins(path: Path, table: list[tuple[int, list[float]]]) -> None:
    """Refuse a point that stands in two lines."""
    first: dict[tuple[float, ...], int] = {}
    for line, row in table:
        other = first.setdefault(tuple(row[:3]), line)
        if other != line:
            x, y, z = row[:3]
            raise RecipeError(
                f"{path}: the point ({x:g}, {y:g}, {z:g}) mm stands in line {other} and in line "
                f"{line}; give each once"
            )


_TOLD = 50
"""Parts of a tissue that the manifest lists at most, the largest first."""


def grown_parts(context: RunContext, part: GrownNetwork) -> GrownParts:
    """The trees that the recipe asks for, and what each part of the tissue gets."""
    if part.inlets is not None:
        options = growth_options(part, context.recipe.seed, context.recipe_folder)
        given = () if part.inlets == "each_part" else part.inlets
        places = [Inlet(one.at_mm, one.direction) for one in given]
        return grow_parts(context.tissue, options, places)
    tree = grown_tree(context, part)
    supply, notes = check_supply(context.tissue, *terminals_of([tree]))
    return GrownParts((tree,), supply, (*tree.notes, *notes))


def supply_report(supply: Sequence[PartSupply]) -> dict[str, Any]:
    """What the report says of a tissue of several parts; nothing of one part."""
    if len(supply) < 2:
        return {}
    return {"parts": len(supply), "supply": [asdict(one) for one in supply[:_TOLD]]}


def grown_tree(context: RunContext, part: GrownNetwork) -> VesselTree:
    """Grow the tree that the recipe asks for."""
    seed, folder = context.recipe.seed, context.recipe_folder
    options = growth_options(part, seed, folder)
    if part.printable:
        return printable_tree(context, part, options)
    return grow_tree(context.tissue, options, trunk=read_trunk(part, folder))


def anatomic_trees(context: RunContext, part: GrownNetwork) -> AnatomicTrees:
    """The trees of the organ that the recipe names.

    What the recipe leaves open of Murray's exponent and the pressure drop is the template's.
    """
    anatomy = part.anatomy
    if anatomy is None:
        raise RecipeError("the recipe names no anatomy; add anatomy: {template: ...}")
    options = growth_options(part, context.recipe.seed, context.recipe_folder)
    preset = PRESETS[anatomy.template]
    own = part.model_fields_set
    if "murray_exponent" not in own:
        options = replace(options, murray_exponent=preset.murray_exponent)
    if "pressure_drop_mmhg" not in own:
        options = replace(options, pressure_drop_pa=preset.pressure_drop_mmhg * PA_PER_MMHG)
    free = "pressure_drop_mmhg" not in own
    trees = grow_or_advise(
        lambda one: _grown(context.tissue, one, anatomy, free),
        options,
        LEAST_IN_CORTEX if anatomy.template == "cortex" else LEAST_TERMINALS,
        # Where another pressure drop doesn't fit, a heart keeps the one that does.
        lambda one: _grown(context.tissue, one, anatomy, False),
    )
    # A heart's coronaries share the tissue; of other organs each tree serves all of it.
    ends, flow = terminals_of(trees.trees if anatomy.template == "heart" else trees.trees[:1])
    tissue = replace(context.tissue, demand=trees.demand or context.tissue.demand)
    _, notes = check_supply(tissue, ends, flow)
    return replace(trees, notes=(*trees.notes, *notes, *uneven_notes(tissue, ends)))


def _grown(
    tissue: Tissue, options: GrowthOptions, part: AnatomyPart, published_radii: bool
) -> AnatomicTrees:
    at = {name: inlet.at_mm for name, inlet in part.inlets.items()}
    if part.template == "kidney":
        given: dict[str, Any] = {
            "hilum_mm": at.get("hilum"),
            "vein": part.vein,
            "cortex_mm": part.cortex_mm,
            "cortex_demand": part.cortex_demand,
            "trunk_ends": part.trunk_ends,
        }
        return grow_kidney(tissue, options, KidneyAnatomy(**_known(given)))
    if part.template == "liver":
        given = {
            "porta_mm": at.get("porta_hepatis"),
            "cava_mm": at.get("vena_cava"),
            "trunk_ends": part.trunk_ends,
        }
        return grow_liver(tissue, options, LiverAnatomy(**_known(given)))
    if part.template == "cortex":
        given = {
            "entry_mm": at.get("pial_artery"),
            "pial_direction": part.pial_direction,
            "thickness_mm": part.cortex_mm,
            "trunk_ends": part.trunk_ends,
            "trunk_depth_mm": part.trunk_depth_mm,
            "arterioles_per_mm2": part.arterioles_per_mm2,
        }
        return grow_cortex(tissue, options, CortexAnatomy(**_known(given)))
    given = {
        "trunk_ends": part.trunk_ends,
        "trunk_depth_mm": part.trunk_depth_mm,
        "base": part.base_direction,
        "right": part.right_direction,
        "left_ostium_mm": at.get("left_coronary"),
        "right_ostium_mm": at.get("right_coronary"),
        "published_radii": published_radii,
    }
    return grow_heart(tissue, options, HeartAnatomy(**_known(given)))


def _known(given: dict[str, Any]) -> dict[str, Any]:
    """What the recipe says; the rest is as by default."""
    return {name: value for name, value in given.items() if value is not None}


def printable_tree(context: RunContext, part: GrownNetwork, options: GrowthOptions) -> VesselTree:
    """As large a tree as needle and method can print; its notes say how far it got and why."""
    limits = printability(context, part.smallest_diameter_mm)
    wall = max(options.clearance_mm, limits.wall_mm)
    done = grow_printable(
        context.tissue,
        replace(options, smallest_radius_mm=limits.lumen_mm / 2, clearance_mm=wall),
        widest_radius_mm=None if limits.widest_mm is None else limits.widest_mm / 2,
    )
    kept = (
        f"lumens of {limits.lumen_mm:.3g} mm and walls of {wall:.3g} mm or more kept "
        f"({limits.says})"
    )
    notes = (kept, done.note) if done.note else (kept,)
    return replace(done.tree, notes=(*notes, *done.tree.notes))


def closed_loop(tissue: Tissue, part: ClosedLoop, seed: int) -> tuple[ClosedLoops, tuple[str, ...]]:
    """Artery and vein, grown in turn, and every terminal of the one joined to one of the other.

    Where a few had to be pruned, the others are balanced anew, by narrowing alone. With it come
    notes on what the artery or the vein doesn't reach.
    """
    artery = growth_options(part, seed)
    vein = replace(artery, root_point_mm=part.vein_root_mm, root_direction=part.vein_root_direction)
    roots = [RootSpec(artery, VesselKind.ARTERY), RootSpec(vein, VesselKind.VEIN)]
    arterial, venous = grow_forest(tissue, roots)
    notes = [
        f"{name}: {note}"
        for name, tree in (("artery", arterial), ("vein", venous))
        for note in check_supply(tissue, *terminals_of([tree]))[1]
    ]
    closed = close_loops(tissue, arterial, venous, loop_options(part, seed))
    return rebalanced(closed, artery, artery.flow_ul_s(tissue.volume_mm3)), tuple(notes)


def rebalanced(closed: ClosedLoops, options: GrowthOptions, flow_ul_s: float) -> ClosedLoops:
    """Equal flows again where terminals were pruned, by narrowing alone."""
    if not closed.pruned:
        return closed
    conditions = FlowConditions(options.viscosity_pa_s, inlet_flow_ul_s=flow_ul_s)
    thinnest = options.smallest_radius_mm or 0.0
    narrowed = balance(closed.network, conditions, widen=False, smallest_radius_mm=thinnest)
    return replace(closed, network=narrowed)


def loops_report(closed: ClosedLoops) -> dict[str, int]:
    """What the report says of how the loops were closed."""
    return {
        "connections": closed.connections,
        "routed": closed.routed,
        "shortened_terminals": closed.shortened,
        "pruned_pairs": closed.pruned,
    }


# Grow all trees of a `grow: forest` recipe; join each network's terminals as the recipe says.


def grown_forest(
    tissue: Tissue, part: Forest, seed: int, recipe_folder: Path
) -> tuple[VesselNetwork, dict[str, Any]]:
    """All networks in one, and what the report says of each."""
    given, notes = _given(part, recipe_folder)
    shared = growth_options(part, seed)
    roots = _roots(part, shared, recipe_folder)
    trees = grow_forest(tissue, roots, beside=given)
    grown = _by_network(part, trees)
    network, closed = join_forest(
        tissue,
        grown,
        loop_options(part, seed),
        given,
        lambda one: rebalanced(one, shared, shared.flow_ul_s(tissue.volume_mm3)),
    )
    notes += _supply_notes(tissue, part, trees)
    facts: dict[str, Any] = {
        "networks": [_tree_facts(*each) for each in zip(part.grown, closed, strict=True)]
    }
    return network, facts | ({"notes": list(notes)} if notes else {})


def _given(part: Forest, folder: Path) -> tuple[VesselNetwork | None, tuple[str, ...]]:
    if part.given is None:
        return None, ()
    return read_with_notes(folder / part.given.network, part.given.unit)


def _roots(part: Forest, shared: GrowthOptions, folder: Path) -> list[RootSpec]:
    """Each tree's options, trunk and territory."""
    roots = []
    for number, one in enumerate(part.grown):
        whole = part.territories == "whole" or (
            part.territories == "by_network" and one.how == "mixing"
        )
        group = 0 if part.territories == "divided" else number
        for tree in one.trees:
            roots.append(
                RootSpec(
                    _options(part, one, tree, shared),
                    VesselKind[tree.kind.upper()],
                    _trunk(tree, folder),
                    Surroundings() if whole else None,
                    group,
                )
            )
    return roots


def _trunk(tree: TreePart, folder: Path) -> Any:
    if tree.trunk is None:
        return None
    return trunk_of(read_network(folder / tree.trunk, tree.trunk_unit))


def _options(part: Forest, one: GrownTrees, tree: TreePart, shared: GrowthOptions) -> GrowthOptions:
    drop, thinnest = tree.pressure_drop_mmhg, tree.smallest_diameter_mm
    return replace(
        shared,
        terminals=part.terminals_of(tree),
        perfusion_ml_min_per_ml=_perfusion(part, one, tree),
        pressure_drop_pa=shared.pressure_drop_pa if drop is None else drop * PA_PER_MMHG,
        smallest_radius_mm=shared.smallest_radius_mm if thinnest is None else thinnest / 2,
        root_point_mm=tree.root_mm,
        root_direction=tree.root_direction,
    )


def _perfusion(part: Forest, one: GrownTrees, tree: TreePart) -> float:
    """A tree's own; drains of a mixing network share what its arteries bring."""
    if tree.perfusion_ml_min_per_ml is not None:
        return tree.perfusion_ml_min_per_ml
    if one.how != "mixing" or tree.kind == "artery":
        return part.perfusion_ml_min_per_ml
    brought = sum(
        each.perfusion_ml_min_per_ml or part.perfusion_ml_min_per_ml
        for each in one.trees
        if each.kind == "artery"
    )
    given = [each.perfusion_ml_min_per_ml for each in one.trees if each.kind != "artery"]
    left = brought - sum(value for value in given if value is not None)
    return max(left / given.count(None), 1e-6)


def _by_network(part: Forest, trees: tuple[VesselTree, ...]) -> list[JoinedTrees]:
    first, groups = 0, []
    for one in part.grown:
        kinds = tuple(VesselKind[tree.kind.upper()] for tree in one.trees)
        groups.append(JoinedTrees(trees[first : first + len(kinds)], kinds, one.how))
        first += len(kinds)
    return groups


def _supply_notes(tissue: Tissue, part: Forest, trees: tuple[VesselTree, ...]) -> tuple[str, ...]:
    """Places that trees of one kind don't reach, of a network or of all that divide the tissue."""
    together: dict[str, list[VesselTree]] = {}
    members = [(number, tree.kind) for number, one in enumerate(part.grown) for tree in one.trees]
    for (number, kind), tree in zip(members, trees, strict=True):
        who = kind if part.territories == "divided" else f"network {number}, {kind}"
        together.setdefault(who, []).append(tree)
    return tuple(
        f"{who}: {note}"
        for who, own in together.items()
        for note in check_supply(tissue, *terminals_of(own))[1]
    )


def _tree_facts(one: GrownTrees, closed: ClosedLoops) -> dict[str, Any]:
    kinds = [tree.kind for tree in one.trees]
    joined = {} if one.how == "none" else loops_report(closed)
    return {"trees": kinds, "join": one.how, **joined}
