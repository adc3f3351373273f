"""Fit an organ's trees: vessels apart, in the tissue, curved, with so many terminals."""

from __future__ import annotations

from dataclasses import replace
from math import ceil

import numpy as np

from design.anatomy.curves import (
    STRAIGHT,
)
from design.anatomy.fitting.bends import curve_trees, kinks, misfits
from design.anatomy.fitting.goal import FIT, Clearance, Goal, Segments, Trees
from design.anatomy.fitting.push_apart import push_apart
from design.anatomy.fitting.remove_terminals import trimmed, without
from design.anatomy.trunk_lines import outward
from design.errors import GrowthError, WideTrunkError
from design.tissue import Tissue
from kernels.arrays import IntArray


def fit_trees(tissue: Tissue, trees: Trees, goal: Goal) -> Trees:
    """Push trees apart, curve and prune them until the goal is reached.

    Parameters
    ----------
    trees : tuple of VesselTree
        With some terminals to spare and the flow that they keep (`with_flows`), grown with more
        clearance than is kept.

    Raises
    ------
    CrowdedError
        When too many terminals don't fit.
    WideTrunkError
        When trunks that feed many are too wide for the wall.
    GrowthError
        When something doesn't fit after all rounds.
    """
    clearance, closer = goal.clearance, goal.clearance._replace(room=FIT.room)
    # What is pruned for good goes before vessels are curved and fit closely.
    done, least = _cleared(tissue, trees, closer, goal.shallow_mm), STRAIGHT
    spare, fewest = (ceil(part * goal.terminals) for part in (FIT.spare, FIT.least_spare))
    for _ in range(FIT.rounds):
        done = _cleared(tissue, trimmed(done, goal, spare), closer, goal.shallow_mm)
        done, bad = curve_trees(tissue, done, closer, least, FIT.again)
        least, final = FIT.again, done
        if bad.total:
            continue
        final = trimmed(done, goal, 0)
        if misfits(tissue, final, clearance).total:
            final = push_apart(tissue, final, clearance)
            if kinks(final):
                final, _ = curve_trees(tissue, final, clearance, FIT.again, FIT.again)
        bad = misfits(tissue, final, clearance)
        if not bad.total and not kinks(final):
            return final
        spare = max(fewest, spare // 4)
    raise GrowthError(
        f"{len(bad.pairs)} pairs of vessels are too near, {len(bad.out)} pieces out of the tissue "
        f"and {kinks(final)} kinks are left after {FIT.rounds} rounds; ask for fewer terminals or "
        "a higher pressure_drop_mmhg"
    )


def with_flows(trees: Trees, goal: Goal) -> Trees:
    """Return trees whose terminals have the flow that is theirs when those to spare are gone."""
    inflow = [float(tree.flow_ul_s[0]) for tree in trees]
    flows = [sum(inflow) if goal.shared else one for one in inflow]
    return tuple(
        replace(tree, terminal_flow_ul_s=flow / goal.terminals)
        for tree, flow in zip(trees, flows, strict=True)
    )


def _cleared(tissue: Tissue, trees: Trees, clearance: Clearance, shallow_mm: float | None) -> Trees:
    """Return the trees pushed apart, without what then doesn't fit."""
    for _ in range(FIT.rounds):
        trees = push_apart(tissue, trees, clearance, shallow_mm)
        bad = misfits(tissue, trees, clearance)
        if not bad.total:
            break
        check_trunks(tissue, trees, bad.out, clearance.mm)
        trees = without(trees, bad)
    return trees


def check_trunks(tissue: Tissue, trees: Trees, out: IntArray, clearance_mm: float) -> None:
    """Raise if trunk pieces, numbered on, that reach ``out`` of the tissue feed too many terminals.

    Such a piece is too wide for the wall, wherever it is moved.

    Raises
    ------
    WideTrunkError
    """
    every = Segments.of(trees)
    total = sum(int(tree.terminals[0]) for tree in trees)
    out = out[every.given[out] & (every.fed[out] > FIT.feeds_many * total)]
    if not len(out):
        return
    end, radius = every.end[out], FIT.wider * every.radius[out]
    # What was moved may lie beyond the middle of the wall.
    across = np.linspace(-0.5, 0.5, FIT.places_across)[:, None, None] * outward(tissue, end)
    places = (end + radius[:, None] * across).reshape(-1, 3)
    deep = -tissue.grid.distance(places).reshape(len(across), -1).min(axis=0) - clearance_mm
    worst = int(np.argmin(deep / radius))
    # A piece's end may have room where its middle hasn't.
    narrower = min(1.0 / FIT.wider, max(float(deep[worst] / radius[worst]), 0.1))
    x, y, z = end[worst]
    raise WideTrunkError(
        f"a trunk {2 * radius[worst]:.3g} mm wide, which feeds {every.fed[out[worst]]} of {total} "
        f"terminals, doesn't fit in the wall near ({x:.4g}, {y:.4g}, {z:.4g}) mm: beside "
        f"clearance_mm there's room for {2 * max(float(deep[worst]), 0.0):.3g} mm",
        drop_factor=FIT.margin * narrower**-4,
    )
