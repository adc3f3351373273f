"""Grow several trees in one tissue without contact: artery, vein and lymph, or several inlets."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from design.errors import DesignError, GrowthError, NoRoomError, RootError
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature.growth.mouths import far_mouths, find_mouths
from design.vasculature.growth.root import (
    default_root_note,
    has_default_root,
    mouth_reaches,
    rooted_at,
    stem,
)
from design.vasculature.growth.territories import Surroundings, part_tissue
from design.vasculature.growth.tree import EFFORT, SPREADS, TreeGrowth
from design.vasculature.growth.trunk import Trunk
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_to_network
from kernels.arrays import FloatArray

STEM_CLEARANCE_FACTOR = 1.5
"""Stems of trees yet to grow are kept clear with this much larger radii."""

PIPE_LENGTH_FACTOR = 2.0
"""Length of a pipe of the root's resistance over the tissue's edge, for a stem's first guess."""


@dataclass(frozen=True)
class RootSpec:
    """One tree of a forest.

    Attributes
    ----------
    options : GrowthOptions
        Without a root point the first tree begins inside a face, on top where there is one
        (`growth.mouths`), later ones in faces as far from the earlier roots as their stems allow.
    kind : VesselKind
        Trees of the same kind part the tissue among them by their numbers of terminals, so that
        every terminal of a kind serves the same volume; kinds pervade each other.
    trunk : Trunk, optional
        Growth goes on from it, and needs no root point.
    territory : Surroundings, optional
        What part of the tissue the tree has, in place of one found by its stem.
    group : int
        Trees of one kind part the tissue among those of their group alone.
    """

    options: GrowthOptions
    kind: VesselKind = VesselKind.ARTERY
    trunk: Trunk | None = None
    territory: Surroundings | None = None
    group: int = 0


@dataclass(frozen=True)
class _Stem:
    """A root's stem, or its trunk, before anything grows: axes (k, 3) and radii (k,), mm."""

    begin: FloatArray
    end: FloatArray
    radius: FloatArray


def grow_forest(
    tissue: Tissue,
    roots: Sequence[RootSpec | GrowthOptions],
    plots: Sequence[Surroundings] | None = None,
    beside: VesselNetwork | None = None,
    *,
    attempts: int = EFFORT.attempts,
) -> tuple[VesselTree, ...]:
    """Grow trees in turn, each clear of the others.

    All stems are placed first. Then each tree in turn grows to twice its terminals among the
    others as they stand, so that all trunks are there before any twig. What the final audit finds
    too near, within a tree or between two, is pruned and grown elsewhere. Each tree keeps its own
    options' clearance from the others.

    Parameters
    ----------
    tissue : Tissue
    roots : sequence of RootSpec or GrowthOptions
        Bare options make a tree that has the whole tissue to itself.
    plots : sequence of Surroundings, optional
        The territory of each tree, in place of those that follow from the numbers of terminals.
    beside : VesselNetwork, optional
        Vessels that are there already and stay; the trees keep clear of them.
    attempts : int
        Growths from other random numbers at most, where one gets stuck.

    Returns
    -------
    tuple of VesselTree
        In the order asked for; same tissue and roots, same bytes.

    Raises
    ------
    TissueError, GrowthError
        As `grow_tree`, naming the tree; and when two stems collide or no root is asked for.
    """
    if not roots:
        raise GrowthError("a forest of no roots was asked for; give at least one")
    options = [_options(root) for root in roots]
    stems: list[_Stem] = []
    trunks = [root.trunk if isinstance(root, RootSpec) else None for root in roots]
    for number, (settings, trunk) in enumerate(zip(options, trunks, strict=True)):
        if trunk is not None:
            radius = np.full(len(trunk.parent), trunk.root_radius_mm)
            stems.append(_Stem(trunk.proximal, trunk.distal, radius))
            continue
        options[number] = _with_root(tissue, settings, stems)
        stems.append(_stem(tissue, options[number]))
    plots = plots or _territories(tissue, roots, options, stems)
    error: DesignError = GrowthError("not tried")
    attempt = 0
    for attempt in range(attempts):
        growths = [
            # Numbers of its own for each tree: the same points would be taken already.
            TreeGrowth.open(
                tissue,
                settings,
                plot,
                settings.terminal_spread or _spread(attempt),
                attempt + EFFORT.attempts * number,
                trunk,
            )
            for number, (settings, plot, trunk) in enumerate(
                zip(options, plots, trunks, strict=True)
            )
        ]
        try:
            trees = _grow_all(growths, stems, beside)
            return tuple(map(_with_root_note, roots, trees))
        except DesignError as failed:
            error = failed
            # Where nothing fits beside a trunk, other random numbers find no place either.
            if isinstance(failed, NoRoomError) and not failed.placed:
                break
    raise error.around(after=f" (last of {attempt + 1} attempts)" if attempt else "") from error


def _grow_all(
    growths: list[TreeGrowth], stems: list[_Stem], beside: VesselNetwork | None
) -> tuple[VesselTree, ...]:
    """Let the growths double in turn, then repair them in turn until all fit."""
    number = 0
    try:
        for number, growth in enumerate(growths):
            growth.meet(_others(growths, stems, number, beside))
            growth.start()
        until = 4
        while any(growth.terminals < growth.options.terminals for growth in growths):
            for number, growth in enumerate(growths):
                growth.meet(_others(growths, stems, number, beside))
                growth.grow(until)
            until *= 2
        for _ in range(EFFORT.audits):
            left = 0
            for number, growth in enumerate(growths):
                growth.meet(_others(growths, stems, number, beside))
                bad = growth.audit()
                left += bad
                if bad:
                    growth.repair()
                    growth.grow()
            if left == 0:
                return tuple(growth.tree() for growth in growths)
    except DesignError as error:
        raise error.around(f"tree {number} of {len(growths)}: ") from error
    raise GrowthError(
        f"{left} vessels of the forest still collide or leave the tissue after {EFFORT.audits} "
        "repairs; ask for fewer terminals, a smaller smallest_diameter_mm or clearance_mm"
    )


def _spread(attempt: int) -> float:
    return SPREADS[attempt % len(SPREADS)]


def forest_to_network(
    trees: Sequence[VesselTree], kinds: Sequence[VesselKind] | None = None
) -> VesselNetwork:
    """All trees as one network, unconnected; veins and lymph flow from terminals to root.

    Parameters
    ----------
    kinds : sequence of VesselKind, optional
        Of each tree; arteries by default.
    """
    kinds = kinds or [VesselKind.ARTERY] * len(trees)
    parts = [
        directed(tree_to_network(tree, kind, number))
        for number, (tree, kind) in enumerate(zip(trees, kinds, strict=True))
    ]
    return joined_networks(parts)


def directed(network: VesselNetwork) -> VesselNetwork:
    """A network of straight vessels, flow turned round in veins and lymph."""
    drains = np.isin(network.kind, (VesselKind.VEIN, VesselKind.LYMPH))
    ends = np.where(drains[:, None], network.vessel_nodes[:, ::-1], network.vessel_nodes)
    return VesselNetwork.from_segments(
        network.nodes, ends, network.radius[::2], network.kind, network.tree
    )


def joined_networks(parts: Sequence[VesselNetwork]) -> VesselNetwork:
    """Several networks as one, nodes numbered on."""
    first_node = np.cumsum([0] + [len(part.nodes) for part in parts])
    first_point = np.cumsum([0] + [len(part.points) for part in parts])
    return VesselNetwork(
        nodes=np.concatenate([part.nodes for part in parts]),
        vessel_nodes=np.concatenate(
            [part.vessel_nodes + first for part, first in zip(parts, first_node, strict=False)]
        ),
        kind=np.concatenate([part.kind for part in parts]),
        tree=np.concatenate([part.tree for part in parts]),
        offset=np.concatenate(
            [[0]]
            + [part.offset[1:] + first for part, first in zip(parts, first_point, strict=False)]
        ),
        points=np.concatenate([part.points for part in parts]),
        radius=np.concatenate([part.radius for part in parts]),
    )


def _with_root_note(root: RootSpec | GrowthOptions, tree: VesselTree) -> VesselTree:
    """The tree, its notes saying where its root is if nobody named it."""
    if not has_default_root(_options(root)) or (isinstance(root, RootSpec) and root.trunk):
        return tree
    kind = root.kind.name.lower() if isinstance(root, RootSpec) else "artery"
    note = default_root_note(tree.proximal[0], tree.distal[0], f"root of the {kind}")
    return replace(tree, notes=(note, *tree.notes))


def _options(root: RootSpec | GrowthOptions) -> GrowthOptions:
    return root.options if isinstance(root, RootSpec) else root


def _stem(tissue: Tissue, options: GrowthOptions) -> _Stem:
    """The stem of a root, as wide as it can be there."""
    *wider, narrowest = _stem_radii(tissue, options)
    for radius in wider:
        with suppress(RootError):
            return _stem_of(tissue, options, radius)
    return _stem_of(tissue, options, narrowest)


def _stem_of(tissue: Tissue, options: GrowthOptions, radius: float) -> _Stem:
    begin, end = stem(tissue, options, radius, options.clearance_mm)
    return _Stem(begin[None], end[None], np.array([STEM_CLEARANCE_FACTOR * radius]))


def likely_radius(tissue: Tissue, options: GrowthOptions) -> float:
    """Radius of one root for the whole flow, before there is a tree, mm."""
    if options.smallest_radius_mm is not None:
        spread = options.terminal_spread or 1.5
        count = float(options.terminals)
        return options.smallest_radius_mm * spread * count ** (1.0 / options.murray_exponent)
    across = PIPE_LENGTH_FACTOR * float(np.cbrt(tissue.volume_mm3))
    flow = options.flow_ul_s(tissue.volume_mm3)
    resistance = 8.0 * options.viscosity_pa_s * across / pi
    return float((flow * resistance / options.pressure_drop_pa) ** 0.25)


def _with_root(tissue: Tissue, options: GrowthOptions, stems: list[_Stem]) -> GrowthOptions:
    """The options with a root point, found on the surface where none is given."""
    if not has_default_root(options):
        return options
    taken = np.concatenate([one.begin[:1] for one in stems]) if stems else None
    direction = None
    if options.root_direction is not None:
        direction = np.array(options.root_direction) / np.linalg.norm(options.root_direction)
    last: DesignError | None = None
    for radius in _stem_radii(tissue, options):
        for reach in mouth_reaches(options, radius, options.clearance_mm):
            places = (
                find_mouths(tissue, reach, direction)
                if taken is None
                else far_mouths(tissue, reach, direction, taken)
            )
            for place in places:
                way = place.inward if direction is None else direction
                trial = rooted_at(options, place.point, way)
                try:
                    stem(tissue, trial, radius, options.clearance_mm)
                except DesignError as error:
                    last = last or error
                    continue
                return trial
    raise RootError(
        f"no face has room for the trunk of root {len(stems)}; choose a root (root_mm), fewer "
        "terminals, a smaller smallest_diameter_mm or clearance_mm"
        + (f". At the first place tried: {last}" if last else "")
    ) from last


def _stem_radii(tissue: Tissue, options: GrowthOptions) -> list[float]:
    """Radii that a root may get, the widest first, mm."""
    if options.smallest_radius_mm is None or options.terminal_spread is not None:
        return [likely_radius(tissue, options)]
    spreads = sorted(SPREADS, reverse=True)
    return [likely_radius(tissue, replace(options, terminal_spread=one)) for one in spreads]


def _territories(
    tissue: Tissue,
    roots: Sequence[RootSpec | GrowthOptions],
    options: list[GrowthOptions],
    stems: list[_Stem],
) -> list[Surroundings]:
    """For each tree its territory; the whole tissue where it is alone of its kind."""
    specs = [root if isinstance(root, RootSpec) else None for root in roots]
    territories = [(spec and spec.territory) or Surroundings() for spec in specs]
    for kind, group in sorted({(spec.kind, spec.group) for spec in specs if spec is not None}):
        of_kind = [
            n
            for n, spec in enumerate(specs)
            if spec and (spec.kind, spec.group) == (kind, group) and not spec.territory
        ]
        if len(of_kind) < 2:
            continue
        wanted = np.array([options[n].terminals for n in of_kind], dtype=np.float64)
        wanted /= wanted.sum()
        parts = part_tissue(tissue, np.array([stems[n].end[0] for n in of_kind]), wanted)
        for place, n in enumerate(of_kind):
            # The flow follows the terminals exactly, so that all of a kind have the same.
            territories[n] = Surroundings(owns=parts.owns(place), share=float(wanted[place]))
    return territories


def _others(
    growths: list[TreeGrowth], stems: list[_Stem], own: int, beside: VesselNetwork | None
) -> Surroundings:
    """All other trees as they stand, the stems of those that haven't begun, and what is given."""
    start, end, radius = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty(0)]
    if beside is not None:
        begins, ends, r0, r1, _ = beside.pieces()
        start.append(begins)
        end.append(ends)
        radius.append(np.maximum(r0, r1))
    for number, growth in enumerate(growths):
        if number == own:
            continue
        if growth.count == 0:
            start.append(stems[number].begin)
            end.append(stems[number].end)
            radius.append(stems[number].radius)
            continue
        s = growth.segments[: growth.count]
        start.append(np.column_stack([s["px"], s["py"], s["pz"]]))
        end.append(np.column_stack([s["dx"], s["dy"], s["dz"]]))
        radius.append(s["radius"])
    return replace(
        growths[own].others,
        start=np.concatenate(start),
        end=np.concatenate(end),
        radius=np.concatenate(radius),
    )
