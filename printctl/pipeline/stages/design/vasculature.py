"""Stage 2: make the vessel network by the recipe's source, and write it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from design.errors import DesignError
from design.hemodynamics import scaled_network
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.network_files.json_format import write_network_npz
from printctl.pipeline import network_sources
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.design.regrowing import with_what_fits
from printctl.progress import Report
from printctl.recipe.sections.forest import Forest
from printctl.recipe.sections.growth import (
    ClosedLoop,
    GivenNetwork,
    GrownNetwork,
    LatticeNetwork,
    NamedNetwork,
)
from printctl.run_folder.artefacts import NETWORK, NETWORK_ARRAYS, SURFACE

if TYPE_CHECKING:
    from printctl.pipeline.context import RunContext

DESIGNED = "network_designed.csv"
"""In the design's size, where the print's is another."""
LARGE = 100_000
"""Vessels from which the network is written as arrays too: read and written many times faster."""


def depends(context: RunContext) -> Any:
    """Return the section, the seed, digests of the files it names, and the printable limits."""
    part = context.recipe.vasculature
    section = part.model_dump(mode="json")
    section["digests"] = context.digests(part.files())
    if isinstance(part, GrownNetwork) and part.printable:
        # These follow from the toolpath's section and its needle.
        limits = context.printability(part.smallest_diameter_mm)
        section["limits_mm"] = [limits.lumen_mm, limits.widest_mm, limits.wall_mm]
    return [section, context.recipe.seed, context.recipe.print_scale]


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Make the network; write it in the print's size, which later stages read."""
    begin = time.monotonic()
    try:
        network, more = make_network(context)
    except DesignError as error:
        told = with_what_fits(context, error, time.monotonic() - begin, make_network)
        if told is error:
            raise
        raise told from error
    for note in more.get("notes", ()):
        context.bars.remark("vasculature", note)
    scale, names = context.recipe.print_scale, [NETWORK]
    printed = scaled_network(network, scale)
    write_network_csv(context.folder / NETWORK, printed)
    if printed.vessel_count >= LARGE:
        write_network_npz(context.folder / NETWORK_ARRAYS, printed)
        names.append(NETWORK_ARRAYS)
    if scale != 1:
        write_network_csv(context.folder / DESIGNED, network)
        names.append(DESIGNED)
    return summarise(network) | more, names


def make_network(context: RunContext) -> tuple[VesselNetwork, dict[str, Any]]:
    """Return the recipe's network in the design's size, and its entries for the report."""
    part = context.recipe.vasculature
    match part:
        case NamedNetwork():
            return network_sources.shipped_network()
        case GivenNetwork():
            return network_sources.given_network(context, part)
        case LatticeNetwork():
            return network_sources.lattice_network(context, part)
        case GrownNetwork() if part.anatomy is not None:
            return network_sources.organ_network(context, part)
        case GrownNetwork():
            return network_sources.tree_network(context, part)
        case ClosedLoop():
            return network_sources.loop_network(context, part)
        case Forest():
            return network_sources.forest_network(context, part)


def summarise(network: VesselNetwork) -> dict[str, Any]:
    """Return a network's size for the report."""
    start, end, r0, r1, _ = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    return {
        "vessels": network.vessel_count,
        "terminals": len(network.outlets()),
        "length_mm": float(length.sum()),
        "volume_mm3": float((np.pi / 3 * length * (r0 * r0 + r0 * r1 + r1 * r1)).sum()),
        "diameter_min_mm": float(2 * network.radius.min()),
        "diameter_max_mm": float(2 * network.radius.max()),
    }


STAGE = Stage("vasculature", depends, (SURFACE,), ("kernels", "design"), work)
