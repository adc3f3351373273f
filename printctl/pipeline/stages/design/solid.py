"""Stage 4: lumens and construct as watertight solids, validated on the files read back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from design.network import VesselNetwork
from design.solids import surface_genus, validate_files
from design.tissue import Tissue
from design.vasculature import collisions
from kernels import keep_freed_memory
from kernels.arrays import FloatArray, IntArray
from printctl.pipeline.context import RunContext
from printctl.pipeline.prepared.solid_build import built_solids, checkable, write_solids
from printctl.pipeline.stage import Stage
from printctl.progress import Report
from printctl.recipe.sections.growth import NamedNetwork
from printctl.recipe.sections.tissue import NetworkTissue
from printctl.run_folder.artefacts import NETWORK, SOLID, SURFACE

NAMED: Final = 3
"""Vessels or pairs that a note names, the worst first; the others are counted."""
_MOUTH_RADII: Final = 3.0
"""So near to a port, in its radii, a lumen opens through the surface as it should."""


@dataclass(frozen=True)
class ConstructDesign:
    """Design that a construct was made from, in its own size.

    Attributes
    ----------
    network : VesselNetwork
    tissue : Tissue
    ports : (k,) int64
        Nodes at which lumens open.
    scale : float
        Of the print, whose places are told.
    """

    network: VesselNetwork
    tissue: Tissue
    ports: IntArray
    scale: float = 1.0

    def text(self, point: FloatArray) -> str:
        """A place of the print, as solid.stl and network.csv have it."""
        return "({:.4g}, {:.4g}, {:.4g}) mm".format(*(self.scale * point).tolist())


def no_ports_note(design: ConstructDesign, *, boxed: bool = False) -> str:
    """Sentence on a construct without ports: which free ends come nearest to the surface.

    ``boxed``: the tissue is the box around the network, as the recipe names none.
    """
    network = design.network
    free = np.flatnonzero(network.degree() == 1)
    text = (
        "no vessel's end opens through the tissue's surface (0 ports): the lumens are closed "
        "cavities, which nothing can be fed into or washed out of; "
    )
    text += (
        "the recipe names no tissue, so its box reaches beyond every vessel (tissue.margin_mm): "
        "give a tissue whose surface an inlet and an outlet reach"
        if boxed
        else "let an inlet and an outlet reach the surface"
    )
    if len(free) == 0:
        return f"{text} (no vessel has a free end)"
    depth = -design.tissue.grid.distance(network.nodes[free])
    nearest = np.argsort(depth)[:NAMED]
    named = [
        f"vessel {_vessel_at(network, int(free[k]))} at {design.text(network.nodes[free[k]])}, "
        f"{design.scale * depth[k]:.2g} mm below it"
        for k in nearest
    ]
    return f"{text}; the free ends nearest to it: {'; '.join(named)}"


def handles_note(design: ConstructDesign, genus: int, expected: int) -> str:
    """Sentence on handles that differ: where lumens break out, and which vessels merge.

    Parameters
    ----------
    design : ConstructDesign
    genus, expected : int
        Handles of the construct, as read back, and by the network (`design.solids.topology`).
    """
    places = [*_broken_walls(design), *_merged(design)] or [
        "a lumen breaks through the tissue's surface beside its ends, or vessels merge that the "
        "network keeps apart; where wasn't found: compare solid.stl with network.csv"
    ]
    return (
        f"the construct has {genus} handles, the network asks for {expected}: {'; '.join(places)}; "
        "flows are those of the network, not of this construct; move or thin these vessels"
    )


def _broken_walls(design: ConstructDesign) -> list[str]:
    """Vessels whose wall lies beyond the tissue's surface away from their ports."""
    network = design.network
    start, end, r0, r1, vessel = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    steps = np.maximum(np.ceil(2 * length / np.maximum(np.minimum(r0, r1), 1e-6)), 1).astype(int)
    piece = np.repeat(np.arange(len(steps)), steps + 1)
    first = np.repeat(np.cumsum(steps + 1) - steps - 1, steps + 1)
    share = (np.arange(len(piece)) - first) / steps[piece]
    place = start[piece] + share[:, None] * (end - start)[piece]
    radius = r0[piece] + share * (r1 - r0)[piece]
    beyond = design.tissue.grid.distance(place) + radius
    for port in design.ports.tolist():
        away = np.linalg.norm(place - network.nodes[port], axis=1)
        beyond[away < _MOUTH_RADII * radius] = -np.inf
    worst = _worst_of_each(vessel[piece], beyond)
    if not worst:
        return []
    named = [
        f"vessel {vessel[piece[k]]} by {design.scale * beyond[k]:.2g} mm at {design.text(place[k])}"
        for k in worst[:NAMED]
    ]
    return [
        "lumens break through the tissue's surface beside their ends: "
        f"{', '.join(named)}{_more(worst)}"
    ]


def _worst_of_each(vessel: IntArray, beyond: FloatArray) -> list[int]:
    """Index of each vessel's farthest place beyond the surface, the worst vessel first."""
    order = np.argsort(-beyond, kind="stable")
    order = order[beyond[order] > 0]
    _, first = np.unique(vessel[order], return_index=True)
    return [int(k) for k in order[np.sort(first)]]


def _merged(design: ConstructDesign) -> list[str]:
    """Vessels that run into each other without a joint."""
    pairs = collisions(design.network)
    if not pairs.count:
        return []
    order = np.argsort(pairs.gap_mm, kind="stable")
    _, first = np.unique(np.sort(pairs.vessels[order], axis=1), axis=0, return_index=True)
    worst = [int(k) for k in order[np.sort(first)]]
    named = [
        f"{pairs.vessels[k][0]} and {pairs.vessels[k][1]} by {-design.scale * pairs.gap_mm[k]:.3g}"
        f" mm at {design.text(pairs.place_mm[k])}"
        for k in worst[:NAMED]
    ]
    return [f"vessels merge that the network keeps apart: {', '.join(named)}{_more(worst)}"]


def _more(found: list[int]) -> str:
    return f" and {len(found) - NAMED} more" if len(found) > NAMED else ""


def _vessel_at(network: VesselNetwork, node: int) -> int:
    return int(np.flatnonzero((network.vessel_nodes == node).any(axis=1))[0])


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Build, write, read back, check."""
    with keep_freed_memory():  # an organ's arrays are of a hundred MB, and follow each other
        return _work(context, report)


def _work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    heavy = context.recipe.solid.heavy_facets(context.network.vessel_count)
    if heavy:
        context.bars.remark("solid", heavy)
    built = built_solids(context)
    report(0.6, "writing")
    names, steps = write_solids(context, built)
    report(0.8, "reading back")
    made = [built.lumen, built.construct]
    checks = validate_files([context.folder / name for name in names if checkable(name)], made)
    for check in checks.values():
        check.require_valid()
        if check.crossing_faces:
            context.bars.remark("solid", f"{check.file}: {check.crossing_faces} faces cross others")
    notes = _notes(context, built.ports, (checks[SOLID].genus, built.genus))
    for note in notes:
        context.bars.remark("solid", note)
    summary = {
        "volume_mm3": built.construct.volume_mm3,
        "lumen_volume_mm3": built.lumen.volume_mm3,
        "faces": len(built.construct.faces),
        "watertight": True,
        "ports": len(built.ports),
        "fittings": built.fittings,
        "genus": checks[SOLID].genus,
        "genus_expected": built.genus,
        **({"notes": list(notes)} if notes else {}),
        "files": {name: asdict(check) for name, check in checks.items()},
    }
    if steps:
        summary["step"] = {name: asdict(check) for name, check in steps.items()}
    if built.chamber is not None:
        summary["chamber_genus"] = surface_genus(built.chamber.faces)[0]
    return summary, names


def _notes(context: RunContext, ports: IntArray, genus: tuple[int | None, int]) -> tuple[str, ...]:
    """Sentences on a construct without ports, and on handles (told, expected) that differ."""
    told, expected = genus
    wrong = None if told == expected else told
    if wrong is None and len(ports):
        return ()
    design = ConstructDesign(
        context.designed_network, context.tissue, ports, context.recipe.print_scale
    )
    boxed = isinstance(context.recipe.tissue, NetworkTissue)
    closed = () if len(ports) else (no_ports_note(design, boxed=boxed),)
    return closed if wrong is None else (*closed, handles_note(design, wrong, expected))


def depends(context: RunContext) -> Any:
    """The section, and whether the design has dimples."""
    named = isinstance(context.recipe.vasculature, NamedNetwork)
    return [context.recipe.solid.model_dump(mode="json"), named]


STAGE = Stage(
    "solid",
    depends,
    (SURFACE, NETWORK),
    ("kernels", "design"),
    work,
)
