"""Assign each vessel to a print head as the recipe names, and give each head's line width."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from design.network import VesselKind, VesselNetwork
from kernels.arrays import IntArray
from printctl.errors import UsageError
from printctl.recipe.making import Fresh, HeadPart

_NOBODY = -1


def vessel_heads(network: VesselNetwork, heads: Sequence[HeadPart]) -> IntArray:
    """Head of each vessel, (v,).

    A head's `trees` count before any head's `kinds`; what nobody names the head writes that names
    nothing, or the first one where none names anything.

    Parameters
    ----------
    network : VesselNetwork
    heads : sequence of HeadPart
        Empty for a printer with one.

    Raises
    ------
    UsageError
        For a vessel that no head is to write.
    """
    if all(head.writes_the_rest for head in heads):
        return np.zeros(len(network.kind), dtype=np.int64)
    head_of = np.full(len(network.kind), _NOBODY, dtype=np.int64)
    for number, head in enumerate(heads):
        kinds = [int(VesselKind[kind.upper()]) for kind in head.kinds]
        head_of[np.isin(network.kind, kinds)] = number
    for number, head in enumerate(heads):
        head_of[np.isin(network.tree, list(head.trees))] = number
    rest = next((k for k, head in enumerate(heads) if head.writes_the_rest), _NOBODY)
    head_of[head_of == _NOBODY] = rest
    nobody = np.flatnonzero(head_of == _NOBODY)
    if len(nobody):
        vessel = int(nobody[0])
        kind = VesselKind(int(network.kind[vessel])).name.lower()
        raise UsageError(
            f"vessel {vessel} ({kind}, tree {int(network.tree[vessel])}) is written by no head, "
            f"nor are {len(nobody) - 1} more; name its kind or tree in printer.heads, or let one "
            "head name neither: it writes the rest"
        )
    return head_of


def layer_lines_um(part: Fresh, heads: Sequence[HeadPart], count: int) -> list[float]:
    """Width of each head's lines in layers, µm: a region's own, else the toolpath's.

    Parameters
    ----------
    part : Fresh
    heads : sequence of HeadPart
        Empty for a printer with one.
    count : int
        How many heads the printer has.

    Raises
    ------
    UsageError
        When a region's head isn't there, two regions of a head ask for lines of two widths, or a
        head names vessels, which are no lines in layers.
    """
    for number, head in enumerate(heads):
        if not head.writes_the_rest:
            raise UsageError(
                f"printer.heads.{number} names kinds or trees: vessels are written into a bath "
                "and left open in layers; name the head in toolpath.regions instead (head)"
            )
    widths = [part.line_um] * count
    region_of: dict[int, int] = {}
    for number, region in enumerate(part.regions):
        if region.head is None:
            continue
        if region.head >= count:
            raise UsageError(
                f"toolpath.regions.{number}: head is {region.head}, and the printer has {count} "
                "(counted from 0); name one of them, or choose another profile"
            )
        if region.line_um is None:
            continue
        first = region_of.setdefault(region.head, number)
        widths[region.head] = region.line_um
        if part.regions[first].line_um != region.line_um:
            raise UsageError(
                f"toolpath.regions.{number}: line_um is {region.line_um:g}, and region {first} "
                f"gives the same head {part.regions[first].line_um:g}; a needle writes lines of "
                "one width"
            )
    return widths
