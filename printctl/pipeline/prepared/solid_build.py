"""Build a recipe's solids (lumens, construct, fittings, marks), and write them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.errors import SolidError
from design.network import VesselNetwork
from design.solids import (
    PlacedConnector,
    Port,
    Solid,
    chamber_solid,
    construct_genus,
    construct_solid,
    end_ports,
    fiducial_places,
    find_ports,
    lumen_pair,
    network_genus,
    open_ends,
    read_solid,
    solid_from_surface,
    surface_genus,
    text_solid,
    tube_outside,
    with_connectors,
    with_text,
    write_3mf,
    write_obj,
    write_ply,
    write_solid_vtp,
    write_step,
    write_stl,
)
from design.solids.construct import Vector
from design.solids.dimensions import BORE_BEYOND_MM
from design.solids.files.read import SUFFIXES
from design.solids.topology import edge_faults
from design.solids.tube import FACET_TOLERANCE_MM
from design.tissue.parts import shells_of, surface_parts
from design.vasculature import PLANAR_DIMPLES, Dimple
from kernels.arrays import IntArray
from printctl.pipeline.context import RunContext
from printctl.recipe.sections.growth import NamedNetwork
from printctl.recipe.sections.solid import ChamberPart, ConnectorPart, SolidPart, TextPart
from printctl.run_folder.artefacts import SURFACE

PlacedDimple = tuple[Vector, float]
INTO_BORE_MM = 0.01
"""By how much a lumen goes on into a fitting's bore, so that no skin stays between them."""
_LEAD_IN_MM = 2.0
_NAMED = 3
_CRUMB_MM3 = 1e-6
"""A cube of 10 µm: below what any needle or solver resolves."""
_LEAST_CUT = 0.3
"""Of a dimple's ball that the body must hold; on a flat face it is a half."""


@dataclass(frozen=True)
class RunSolids:
    """The solids of a run.

    Attributes
    ----------
    lumen : Solid
        With round ends.
    construct : Solid
        What is printed.
    chamber : Solid or None
        What it is put into.
    ports : (k,) int64
        Nodes at which the construct's lumens open.
    genus : int
        That the construct should have.
    fittings : int
        On the construct and on the chamber.
    """

    lumen: Solid
    construct: Solid
    chamber: Solid | None
    ports: IntArray
    genus: int
    fittings: int


def build(
    part: SolidPart,
    network: VesselNetwork,
    tissue: Solid,
    tissue_genus: int,
    marks: Sequence[PlacedDimple] = (),
) -> RunSolids:
    """Make all solids that ``part`` asks for.

    Parameters
    ----------
    part : SolidPart
    network : VesselNetwork
    tissue : Solid
    tissue_genus : int
        Its handles.
    marks : sequence of (centre (3,) mm, diameter mm)
        Dimples in the tissue's faces, besides the section's own.

    Raises
    ------
    SolidError
        When something can't be made there, or the construct falls into more parts than the tissue
        (the tubes) had.
    """
    beyond = 2.0 * float(network.radius.max())
    if part.tubes is None:
        body, genus = tissue, tissue_genus
        nodes = open_ends(network, body, beyond)
    else:
        body = tube_outside(network, part.tubes.wall_mm, fillet_ratio=part.fillet_ratio)
        genus, nodes = network_genus(network), np.flatnonzero(network.degree() == 1)
    fitted, bare = _fitted_ports(part, network, body, nodes), body
    if part.tubes is not None:
        _refuse_wide_bores(fitted, part.tubes.wall_mm)
    if fitted:
        body = with_connectors(
            body,
            [
                PlacedConnector(one.connector, port.at, port.outward, name=f"node {port.node}")
                for port, one in fitted
            ],
        )
    dimples = [*(marks if part.tubes is None else []), *_fiducials(part)]
    lumen, tool = _lumens(part, network, nodes, fitted, beyond)
    construct = _dimpled(construct_solid(body, tool), dimples)
    for index, text in enumerate(part.texts):
        construct = _lettered(construct, text, index)
    construct = without_crumbs(construct)
    _refuse_loose_parts(construct, bare)
    chamber, holes = _chamber(part.chamber, network, construct, nodes)
    return RunSolids(
        lumen=lumen,
        construct=construct,
        chamber=chamber,
        ports=nodes,
        genus=construct_genus(network, nodes, genus),
        fittings=len(fitted) + holes,
    )


def without_crumbs(construct: Solid) -> Solid:
    """``construct`` without closed shells below `_CRUMB_MM3`, which faces that graze leave."""
    if surface_genus(construct.faces)[1] == 1:
        return construct
    shell = shells_of(construct.vertices, construct.faces)
    a, b, c = (construct.vertices[construct.faces[:, k]] for k in range(3))
    volume = np.bincount(shell, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)
    faces = construct.faces[np.abs(volume)[shell] >= _CRUMB_MM3]
    used, places = np.unique(faces, return_inverse=True)
    numbers = places.reshape(faces.shape).astype(np.int32)
    return replace(construct, vertices=construct.vertices[used], faces=numbers)


def _refuse_loose_parts(construct: Solid, bare: Solid) -> None:
    if surface_genus(construct.faces)[1] == 1:
        return
    parts = surface_parts(construct.vertices, construct.faces)
    whole = len(surface_parts(bare.vertices, bare.faces))
    if len(parts) > whole:
        loose = "; ".join(map(str, parts[whole : whole + _NAMED]))
        raise SolidError(
            f"the construct falls into {len(parts)} parts, {whole} would hold together: loose "
            f"would be {loose}; move the vessel or the fitting (solid.inlets, solid.outlets) that "
            "cuts it off, or make it thinner"
        )


def _fitted_ports(
    part: SolidPart, network: VesselNetwork, body: Solid, nodes: IntArray
) -> list[tuple[Port, ConnectorPart]]:
    """Ports that get a fitting, on the body's face."""
    if part.inlets is None and part.outlets is None:
        return []
    if part.tubes is None:
        ports = find_ports(network, body, nodes, "the tissue")
    else:
        ports = end_ports(network, nodes)
    return _with_fittings(ports, part.inlets, part.outlets, "solid")


def _with_fittings(
    ports: list[Port], inlets: ConnectorPart | None, outlets: ConnectorPart | None, key: str
) -> list[tuple[Port, ConnectorPart]]:
    pairs = []
    for name, fitting, inlet in (("inlets", inlets, True), ("outlets", outlets, False)):
        chosen = [port for port in ports if port.inlet == inlet]
        if fitting is None:
            continue
        if not chosen:
            raise SolidError(
                f"{key}.{name}: no vessel's {name[:-1]} opens through a face, so there is "
                f"nowhere to put a fitting; leave {key}.{name} out, or let a vessel end at a face"
            )
        for port in chosen:
            # Facets deviate by their tolerance: no thinner wall is certain to be whole.
            thinnest = 2.0 * (port.radius_mm + FACET_TOLERANCE_MM)
            if fitting.kind != "luer_male" and fitting.outer_mm <= thinnest:
                raise SolidError(
                    f"{key}.{name}.outer_mm {fitting.outer_mm:g} isn't wider than the vessel of "
                    f"{2.0 * port.radius_mm:.3g} mm at node {port.node}; make it wider"
                )
            if port.clear_mm <= fitting.length_mm + BORE_BEYOND_MM:
                raise SolidError(
                    f"{key}.{name}: {port.clear_mm:.3g} mm behind the face where the vessel at "
                    f"node {port.node} opens the body begins again, and the fitting is "
                    f"{fitting.length_mm:g} mm long; make length_mm shorter or let the vessel end "
                    "at an outer face"
                )
            pairs.append((port, fitting))
    return pairs


def _refuse_wide_bores(fitted: list[tuple[Port, ConnectorPart]], wall_mm: float) -> None:
    """Refuse a fitting whose bore cuts its tube off."""
    for port, fitting in fitted:
        tube_mm = 2.0 * (port.radius_mm + wall_mm)
        if fitting.bore_mm >= tube_mm - 2.0 * FACET_TOLERANCE_MM:
            raise SolidError(
                f"bore_mm {fitting.bore_mm:g} of the fitting at node {port.node} is as wide as the "
                f"tube it stands on, {tube_mm:.3g} mm outside; make it narrower"
            )


def _lumens(
    part: SolidPart,
    network: VesselNetwork,
    nodes: IntArray,
    fitted: list[tuple[Port, ConnectorPart]],
    beyond_mm: float,
) -> tuple[Solid, Solid]:
    """Lumens with round ends; and drawn out at plain ports, up to the bore at fittings."""
    into = {port.node: max(0.0, port.beyond_mm) + INTO_BORE_MM for port, _ in fitted}
    lengths = np.array([into.get(node, beyond_mm) for node in nodes.tolist()])
    return lumen_pair(
        network,
        lengths,
        nodes,
        fillet_ratio=part.fillet_ratio,
        facet_ratio=part.facet_ratio(network.vessel_count),
    )


def _fiducials(part: SolidPart) -> list[PlacedDimple]:
    return [
        (place, mark.diameter_mm)
        for mark in part.fiducials
        for place in fiducial_places(
            np.array(mark.at_mm), np.array(mark.along), np.array(mark.outward), mark.size_mm
        )
    ]


def _dimpled(construct: Solid, dimples: list[PlacedDimple]) -> Solid:
    if not dimples:
        return construct
    done = construct_solid(construct, None, dimples)
    balls = sum(np.pi / 6.0 * float(wide) ** 3 for _, wide in dimples)
    gone = construct.volume_mm3 - done.volume_mm3
    if gone < _LEAST_CUT * balls:
        raise SolidError(
            f"solid.fiducials: {len(dimples)} dimples of {balls:.3g} mm³ take only {gone:.3g} mm³ "
            "out of the construct; put at_mm on its face, and let the pattern fit there"
        )
    return done


def _lettered(construct: Solid, text: TextPart, index: int) -> Solid:
    letters = text_solid(text.text, text.height_mm, text.depth_mm)
    at, along, outward = (np.array(value) for value in (text.at_mm, text.along, text.outward))
    done = with_text(construct, letters, at, along, outward, engraved=text.engraved)
    changed = abs(done.volume_mm3 - construct.volume_mm3)
    loose = surface_genus(done.faces)[1] - surface_genus(construct.faces)[1]
    if changed < 0.5 * letters.volume_mm3 or loose:
        raise SolidError(
            f"solid.texts.{index}: {text.text!r} isn't on the construct: {changed:.3g} of its "
            f"{letters.volume_mm3:.3g} mm³ count, {loose} parts are loose; put at_mm on a flat "
            "face that has room for it"
        )
    return done


def _chamber(
    part: ChamberPart | None, network: VesselNetwork, construct: Solid, nodes: IntArray
) -> tuple[Solid | None, int]:
    """The chamber around the construct, and how many fittings it has."""
    if part is None:
        return None, 0
    low, high = construct.bounds
    wide = high - low + 2.0 * part.clearance_mm
    if part.shape == "cylinder":
        wide[:2] = float(np.hypot(*(high - low)[:2])) + 2.0 * part.clearance_mm
    inner = (float(wide[0]), float(wide[1]), float(high[2] - low[2]) + part.headroom_mm)
    made = chamber_solid(part.around(inner))
    foot = np.array([*(0.5 * (low + high))[:2], low[2]])
    # Once more through the snapping: moved coordinates aren't float32's any more.
    chamber = solid_from_surface(made.vertices + foot, made.faces)
    if part.inlets is None and part.outlets is None:
        return chamber, 0
    ports = find_ports(network, chamber, nodes, "the chamber", outermost=True)
    fitted = _with_fittings(ports, part.inlets, part.outlets, "solid.chamber")
    foot_mm, rim_mm = chamber.bounds[:, 2].tolist()
    room = (foot_mm, rim_mm - (part.ledge_depth_mm if part.ledge_mm else 0.0))
    placed = []
    for port, fitting in fitted:
        _check_height(port, fitting, room)
        placed.append(
            PlacedConnector(
                fitting.connector,
                port.at,
                port.outward,
                lead_in_mm=min(_LEAD_IN_MM, 0.9 * port.wall_mm),
                through_mm=port.wall_mm + 1.0,
                name=f"node {port.node}",
            )
        )
    return with_connectors(chamber, placed), len(fitted)


def _check_height(port: Port, fitting: ConnectorPart, room: tuple[float, float]) -> None:
    """Refuse a fitting that keeps a lid from closing, or the chamber from standing."""
    wide, z = 0.5 * fitting.outer_mm, float(port.at[2])
    if z + wide > room[1]:
        raise SolidError(
            f"solid.chamber: the fitting at node {port.node} reaches {z + wide - room[1]:.3g} mm "
            "over the chamber's rim, or its lid's ledge; raise headroom_mm or lower outer_mm"
        )
    if z - wide < room[0]:
        raise SolidError(
            f"solid.chamber: the fitting at node {port.node} reaches {room[0] - z + wide:.3g} mm "
            "below the chamber's foot; raise floor_mm or lower outer_mm"
        )


def built_solids(context: RunContext, network: VesselNetwork | None = None) -> RunSolids:
    """All solids of the recipe; a design of ours brings its fiducial dimples.

    ``network`` is put in the design's place where it is given.
    """
    named = isinstance(context.recipe.vasculature, NamedNetwork)
    scale = context.recipe.print_scale
    marks = [_scaled(mark, scale) for mark in PLANAR_DIMPLES] if named else []
    tissue = read_solid(context.folder / SURFACE, unit="mm")
    vessels = context.network if network is None else network
    return build(context.recipe.solid, vessels, tissue, body_genus(tissue.faces), marks)


def _scaled(mark: Dimple, scale: float) -> tuple[tuple[float, float, float], float]:
    x, y, z = mark.centre_mm
    return (x * scale, y * scale, z * scale), mark.diameter_mm * scale


def body_genus(faces: NDArray[np.int32]) -> int:
    """Handles of the tissue itself (a ring has one), by its faces (m, 3)."""
    return 0 if edge_faults(faces) else surface_genus(faces)[0]


WRITERS: Final[dict[str, Callable[[Path, Solid], None]]] = {
    "stl": write_stl,
    "3mf": write_3mf,
    "ply": write_ply,
    "obj": write_obj,
    "vtp": write_solid_vtp,
}


def write_solids(context: RunContext, built: RunSolids) -> tuple[list[str], dict[str, Any]]:
    """Write all files; return their names, and what STEP holds.

    STL is always written, as later stages read it; 3MF holds the construct alone, STEP the lumens.
    """
    part, names = context.recipe.solid, []
    solids = {"lumen": built.lumen, "solid": built.construct, "chamber": built.chamber}
    for kind in dict.fromkeys(("stl", *part.formats)):
        for name, solid in solids.items():
            if solid is None or kind == "step" or (kind, name) == ("3mf", "lumen"):
                continue
            names.append(f"{name}.{kind}")
            WRITERS[kind](context.folder / names[-1], solid)
    if "step" not in part.formats:
        return names, {}
    names.append("lumen.step")
    return names, {names[-1]: write_step(context.folder / names[-1], context.network)}


def checkable(name: str) -> bool:
    """Whether a file can be read back as a mesh."""
    return Path(name).suffix in SUFFIXES
