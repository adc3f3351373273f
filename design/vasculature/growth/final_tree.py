"""Finish a grown tree: set terminal flows by demand, final radii and radius ratios."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from design.tissue import Tissue
from design.vasculature.growth.cost import TRUNK, Segments, follow_radii, refresh_all, spread_down
from design.vasculature.growth.kernel import Scale
from design.vasculature.growth.points import LEAST_FLOW
from design.vasculature.growth.supply import demand_points, points_for, territory_demand
from design.vasculature.growth.trunk import Trunk
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import scaled_to_smallest_radius, tree_from_topology
from design.vasculature.viscosity import ROUNDS, SETTLED
from kernels.arrays import FloatArray

_APART = 1 << 40


def share_by_demand(
    segments: Segments,
    count: int,
    tissue: Tissue,
    options: GrowthOptions,
    owns: Callable[[FloatArray], NDArray[np.bool_]] | None,
) -> None:
    """Give each terminal the flow that its territory asks for."""
    s = segments[:count]
    tips = np.flatnonzero(s["left"] < 0)
    at = np.column_stack([s["dx"], s["dy"], s["dz"]])[tips]
    # Other points than those of a later report, which would find what it put there.
    seed = options.seed + _APART
    points, weight = demand_points(tissue, points_for(options.terminals), seed, owns)
    share = len(tips) * territory_demand(points, weight, at)
    s["flow"][tips] = np.maximum(share, LEAST_FLOW)
    refresh_all(segments, count, options.law)


def final_radii(segments: Segments, count: int, options: GrowthOptions, scale: Scale) -> None:
    """Derive the final radii: by the pressure drop, or as wide as the smallest radius asks for."""
    for _ in range(ROUNDS):
        _radii(segments, count, options, scale)
        if options.law_haematocrit < 0.0:
            return
        if follow_radii(segments, count, options.law)[0] < SETTLED:
            return


def _radii(segments: Segments, count: int, options: GrowthOptions, scale: Scale) -> None:
    law, smallest = options.law, options.smallest_radius_mm
    top = segments[0]
    root = scale.root_radius or float(
        (scale.flow_over_drop * float(top["load"]) / float(top["flow"])) ** 0.25
    )
    thinnest = spread_down(segments, count, root, 1.0, law)
    if smallest is not None and thinnest > smallest:
        root *= smallest / thinnest
        spread_down(segments, count, root, 1.0, law)


@dataclass(frozen=True)
class FinalArrays:
    """What of the growing segments the finished tree is made of; theirs can be let go.

    Attributes
    ----------
    proximal, distal, parent, children, relative_flow, given
        As `tree_from_topology` takes them.
    flow_ul_s, pressure_drop_pa : float
        Into the root, and over the tree.
    notes : tuple of str
    """

    proximal: FloatArray
    distal: FloatArray
    parent: NDArray[np.int32]
    children: NDArray[np.int32]
    relative_flow: FloatArray | None
    given: NDArray[np.bool_]
    flow_ul_s: float
    pressure_drop_pa: float
    notes: tuple[str, ...]

    def tree(self, options: GrowthOptions) -> VesselTree:
        """The finished tree, its ratios computed afresh from geometry and topology."""
        smallest = options.smallest_radius_mm
        tree = tree_from_topology(
            self.proximal,
            self.distal,
            self.parent,
            self.children,
            flow_ul_s=self.flow_ul_s,
            pressure_drop_pa=self.pressure_drop_pa if smallest else options.pressure_drop_pa,
            murray_exponent=options.murray_exponent,
            viscosity_pa_s=options.viscosity_pa_s,
            relative_flow=self.relative_flow,
            haematocrit=options.law_haematocrit,
            given=self.given,
        )
        tree = scaled_to_smallest_radius(tree, smallest) if smallest else tree
        return replace(tree, notes=self.notes) if self.notes else tree


def final_arrays(
    segments: Segments,
    tissue: Tissue,
    options: GrowthOptions,
    scale: Scale,
    trunk: Trunk | None,
) -> FinalArrays:
    """Copy what the finished tree is made of."""
    s = segments
    equal = options.terminal_flow == "equal" and options.terminal_flows is None and trunk is None
    flow = options.flow_ul_s(scale.volume)
    drop = flow * float(s["load"][0]) / (float(s["flow"][0]) * float(s["radius"][0]) ** 4)
    return FinalArrays(
        np.column_stack([s["px"], s["py"], s["pz"]]),
        np.column_stack([s["dx"], s["dy"], s["dz"]]),
        s["parent"].copy(),
        np.column_stack([s["left"], s["right"]]),
        None if equal else s["flow"].copy(),
        s["given"] == TRUNK,
        flow,
        drop,
        () if trunk is None else (_note(s, tissue, trunk),),
    )


def _note(s: Segments, tissue: Tissue, trunk: Trunk) -> str:
    """What the user should know of a trunk."""
    own = s[s["given"] != 0]
    begin, end = (np.column_stack([own[f"{side}{x}"] for x in "xyz"]) for side in "pd")
    out = np.count_nonzero(~tissue.grid.capsule_inside(begin, end, own["radius"]))
    return (
        f"the trunk's {len(trunk.parent)} segments stay where they are (straightened by "
        f"{trunk.moved_mm:.3g} mm at most), but their radii follow from the {s['terminals'][0]} "
        f"terminals that they feed now: {own['radius'][0]:.3g} mm at the root in place of "
        f"{trunk.root_radius_mm:.3g} mm. {out} of its {len(own)} pieces reach out of the tissue, "
        "and it isn't held against itself"
    )
