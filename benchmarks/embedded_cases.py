"""Networks and needles of the embedded writing benchmark, and their G-code by the product."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from design.network import VesselNetwork
from design.network_files.xcavate import read_network_xcavate
from design.tissue import Surface, Tissue, annulus, block, tissue_from_surface
from design.toolpath import Toolpath
from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from design.toolpath.gcode import GcodeOptions, write_gcode
from design.vasculature import GrowthOptions, grow_printable, tree_to_network
from firmware_profiles import Ink, Needle, Printer, Syringe, load
from printctl.pipeline.growing import closed_loop
from printctl.recipe.growth import ClosedLoop

SHARED = Path(
    os.environ.get("PRINTCTL_SHARED_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")
)
PRINTER, SYRINGE, INK = "generic_marlin", "hamilton_1ml", "gelatin_sacrificial"
Z_MM_S = float(load(Printer, PRINTER).max_speed_mm_s.z)
PLACE_MM = (60.0, 60.0, 20.0)
"""Of the network's lowest corner in the printer's frame."""


AS_IT_IS: dict[str, Any] = {
    "thinnest": 1e-6,
    "min_speed_mm_s": 0.01,
    "write_speed_mm_s": 100.0,
    "leave_out": True,
}


@dataclass(frozen=True)
class Case:
    """A network to write, with which needle, and what is promised.

    Attributes
    ----------
    name : str
    needle : str
        Profile.
    network : callable
        Makes it; None where its file isn't there.
    passes, planning_s : float or None
        At most.
    about : str
        How the network came about.
    names : bool
        Whether joints may stay open that the plan names.
    as_it_is : bool
        Whether vessels of any thickness are written, and those left out that can't be in any order.
    slow : bool
        Left out by ``--quick``.
    peer : dict or None
    """

    name: str
    needle: str
    network: Callable[[EmbeddedOptions], VesselNetwork | None]
    passes: int | None
    planning_s: float | None
    about: str
    names: bool = False
    as_it_is: bool = False
    slow: bool = False
    peer: dict[str, Any] | None = None


@dataclass(frozen=True)
class Written:
    """The product's G-code, what its plan says of itself, and how long planning took, CPU s."""

    gcode: Path
    said: Any
    planning_s: float
    options: EmbeddedOptions
    bore_mm: float
    flow_factor: float


def shared_network(name: str) -> VesselNetwork | None:
    """One of X-CAVATE's networks as it comes, cm to mm; None without the file."""
    path = SHARED / f"xcavate_network_{name}_vessels.txt"
    if not path.is_file():
        return None
    (ends,) = SHARED.glob(f"xcavate_inlet_outlet_{name}_vessels*.txt")
    return read_network_xcavate(path, ends).network


def grown(options: EmbeddedOptions, size_mm: tuple[float, float, float]) -> VesselNetwork:
    """499 vessels in a block, no thinner and no nearer to each other than the needle can write."""
    thinnest = options.smallest_lumen_mm / 2
    growth = GrowthOptions(
        terminals=250,
        seed=1,
        smallest_radius_mm=thinnest,
        clearance_mm=options.smallest_wall_mm(thinnest),
    )
    widest = options.largest_lumen_mm / 2
    done = grow_printable(_tissue(block(size_mm)), growth, widest_radius_mm=widest)
    return tree_to_network(done.tree)


def loops(terminals: int) -> VesselNetwork:
    """Artery and vein of so many terminals each in a ring of 6 cm: about five times that."""
    part = ClosedLoop(
        grow="closed_loop",
        terminals=terminals,
        smallest_diameter_mm=0.2,
        clearance_mm=0.2,
        root_mm=(18, 0, 30),
        root_direction=(0, 0, -1),
        vein_root_mm=(-18, 0, 30),
        vein_root_direction=(0, 0, -1),
    )
    return closed_loop(_tissue(annulus(60, 12, 30)), part, 1).network


def _tissue(surface: Surface) -> Tissue:
    return tissue_from_surface(surface.vertices, surface.faces)


def options_of(needle: str, as_it_is: bool = False) -> EmbeddedOptions:
    """As a recipe with that needle and its defaults; open joints are counted, not refused."""
    bore, ink = load(Needle, needle), load(Ink, INK)
    known = {field.name for field in fields(EmbeddedOptions)}
    more: dict[str, Any] = {"open_joints": 1_000_000} if "open_joints" in known else {}
    if as_it_is:
        more |= AS_IT_IS
    return EmbeddedOptions(
        needle_inner_mm=bore.inner_mm,
        needle_outer_mm=bore.outer_mm,
        retract_ul=ink.retract_ul,
        plunger_ul_s=ink.plunger_ul_s,
        **more,
    )


def lowered(network: VesselNetwork) -> VesselNetwork:
    """The same with its lowest corner, radii included, at the origin."""
    return network.moved(-(network.points - network.radius[:, None]).min(axis=0))


def write(
    network: VesselNetwork,
    case: Case,
    folder: Path,
    repeats: int,
    z_mm_s: float = Z_MM_S,
) -> Written:
    """Plan and write; the planning time is the least of ``repeats`` after one to warm up on.

    The printer's z goes at ``z_mm_s``, and lifts near ink, too.
    """
    options = replace(options_of(case.needle, case.as_it_is), lift_speed_mm_s=z_mm_s)
    took = []
    if repeats > 1:
        plan_embedded(network, options)
    for _ in range(repeats):
        begun = time.process_time()
        plan = plan_embedded(network, options)
        took.append(time.process_time() - begun)
    path = folder / "embedded.gcode"
    path.write_bytes(_gcode(plan.toolpath, z_mm_s))
    syringe, ink = load(Syringe, SYRINGE), load(Ink, INK)
    return Written(path, plan.report, min(took), options, syringe.inner_mm, ink.flow_factor)


def _gcode(toolpath: Toolpath, z_mm_s: float = Z_MM_S) -> bytes:
    ink, printer = load(Ink, INK), load(Printer, PRINTER)
    speeds = printer.max_speed_mm_s.model_copy(update={"z": z_mm_s})
    printer = printer.model_copy(update={"max_speed_mm_s": speeds})
    writer = GcodeOptions(
        start_mm=(100.0, 100.0, 120.0),
        travel_speed_mm_s=20.0,
        relieve_ul=ink.retract_ul,
        plunger_ul_s=ink.plunger_ul_s,
        flow_factor=ink.flow_factor,
    )
    return write_gcode(toolpath, printer, load(Syringe, SYRINGE), PLACE_MM, writer).data


def warm() -> None:
    """Compile what planning and writing need, on a fork of three vessels."""
    nodes = np.array([[0.0, 0, 0], [0, 0, 3], [3, 0, 5], [-3, 0, 5]])
    pairs = np.array([[0, 1], [1, 2], [1, 3]])
    kind = np.zeros(3, dtype=np.int64)
    fork = VesselNetwork.from_segments(nodes, pairs, np.full(3, 0.2), kind, kind)
    _gcode(plan_embedded(lowered(fork), options_of("30g")).toolpath)
