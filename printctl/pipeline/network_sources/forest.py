"""Grow all trees of a `grow: forest` recipe; join each network as the recipe says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from design.network import VesselKind, VesselNetwork
from design.network_files.by_suffix import read_network, read_with_notes
from design.tissue import Tissue
from design.units import PA_PER_MMHG
from design.vasculature import (
    ClosedLoops,
    GrowthOptions,
    JoinedTrees,
    RootSpec,
    VesselTree,
    check_supply,
    grow_forest,
    join_forest,
    terminals_of,
)
from design.vasculature.growth.territories import Surroundings
from design.vasculature.growth.trunk import trunk_of
from printctl.pipeline.network_sources.loops import loops_report, rebalanced
from printctl.pipeline.network_sources.options import growth_options, loop_options
from printctl.recipe.sections.forest import Forest, GrownTrees, TreePart

if TYPE_CHECKING:
    from printctl.pipeline.context import RunContext


def forest_network(context: RunContext, part: Forest) -> tuple[VesselNetwork, dict[str, Any]]:
    """Grow the recipe's forest."""
    return grown_forest(context.tissue, part, context.recipe.seed, context.recipe_folder)


def grown_forest(
    tissue: Tissue, part: Forest, seed: int, recipe_folder: Path
) -> tuple[VesselNetwork, dict[str, Any]]:
    """Return all networks in one, and the report's figures of each."""
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
    notes += tuple(note for tree in trees for note in tree.notes)
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
    """Return each tree's options, trunk and territory."""
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
    """Return a tree's perfusion; drains of a mixing network share what its arteries bring."""
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
    """Note places that one kind of tree doesn't reach, by network or by all that share a tissue."""
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
