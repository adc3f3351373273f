"""Embedded writing: moves through written ink, joints, passes, planning, volume.

The G-code is judged by `benchmarks.checkers.embedded_judge`, which shares no code with the product.
X-CAVATE's networks come from `DATA`; without them their rows are skipped.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.checkers.embedded_judge import judge
from benchmarks.common import DATA, Row, limited, needed, row, scratch
from design.errors import DesignError
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.network_files.xcavate import read_network_xcavate
from design.tissue import Surface, Tissue, annulus, block, tissue_from_surface
from design.toolpath import Toolpath
from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from design.toolpath.gcode import GcodeOptions, write_gcode
from design.vasculature import GrowthOptions, grow_printable, tree_to_network
from firmware_profiles import Ink, Needle, Printer, Syringe, load
from printctl.pipeline.network_sources.loops import closed_loop
from printctl.recipe.sections.growth import ClosedLoop

PRINTER, SYRINGE, INK = "generic_marlin", "hamilton_1ml", "gelatin_sacrificial"
PLACE_MM = (60.0, 60.0, 20.0)
"""Of the network's lowest corner in the printer's frame."""

NEAR_MM = 0.5
"""A joint that the checker finds open is the one that the plan names so near to it."""

AS_IT_IS: dict[str, Any] = {"thinnest": 1e-6, "min_speed_mm_s": 0.01, "write_speed_mm_s": 100.0}
AS_IT_IS |= {"leave_out": True}
"""Vessels of any thickness; those that can't be written in any order are left out and named."""


@dataclass(frozen=True)
class Case:
    """A network to write, with which needle, and what is promised: most passes and CPU s.

    ``names``: joints may stay open that the plan names.
    """

    name: str
    needle: str
    network: Callable[[EmbeddedOptions], VesselNetwork]
    passes: int | None = None
    planning_s: float | None = None
    names: bool = False
    as_it_is: bool = False


def shared_network(options: EmbeddedOptions, name: str) -> VesselNetwork:
    """Return one of X-CAVATE's networks as it comes, cm to mm."""
    path = needed(DATA / f"xcavate_network_{name}_vessels.txt")
    (ends,) = DATA.glob(f"xcavate_inlet_outlet_{name}_vessels*.txt")
    return read_network_xcavate(path, ends).network


def grown(options: EmbeddedOptions, size_mm: tuple[float, float, float]) -> VesselNetwork:
    """Return 499 vessels in a block, no thinner and no nearer than the needle can write."""
    thinnest = options.smallest_lumen_mm / 2
    wall = options.smallest_wall_mm(thinnest)
    growth = GrowthOptions(terminals=250, seed=1, smallest_radius_mm=thinnest, clearance_mm=wall)
    widest = options.largest_lumen_mm / 2
    done = grow_printable(_tissue(block(size_mm)), growth, widest_radius_mm=widest)
    return tree_to_network(done.tree)


def loops(options: EmbeddedOptions) -> VesselNetwork:
    """Return artery and vein of 401 terminals each in a ring of 6 cm: some 2,000 vessels."""
    part = ClosedLoop(
        grow="closed_loop", terminals=401, smallest_diameter_mm=0.2, clearance_mm=0.2,
        root_mm=(18, 0, 30), root_direction=(0, 0, -1),
        vein_root_mm=(-18, 0, 30), vein_root_direction=(0, 0, -1),
    )  # fmt: skip
    return closed_loop(_tissue(annulus(60, 12, 30)), part, 1)[0].network


def _tissue(surface: Surface) -> Tissue:
    return tissue_from_surface(surface.vertices, surface.faces)


CASES = (
    Case("14 of X-CAVATE", "30g", partial(shared_network, name="14"), 30, 0.5),
    Case("100 of CNET", "30g", partial(shared_network, name="cnet_100"), 260, 2.0),
    Case("500 grown, 22G", "22g", partial(grown, size_mm=(60.0, 60.0, 45.0)), 1000, 8.0, True),
    Case("500 grown, 30G", "30g", partial(grown, size_mm=(40.0, 40.0, 30.0)), 1000, 8.0, True),
    Case(
        "500 of X-CAVATE as it is, 22G", "22g", partial(shared_network, name="500"), 1200, 8.0,
        names=True, as_it_is=True,
    ),
    Case("2,003 in loops, 30G", "30g", loops, None, 120.0, True),
)  # fmt: skip


def rows(quick: bool) -> Iterator[Row]:
    """Yield all networks; quick has X-CAVATE's two smaller ones."""
    fork = np.array([[0.0, 0, 1], [0, 0, 3], [3, 0, 5], [-3, 0, 5]])
    pairs, kind = np.array([[0, 1], [1, 2], [1, 3]]), np.zeros(3, dtype=np.int64)
    small = VesselNetwork.from_segments(fork, pairs, np.full(3, 0.2), kind, kind)
    plan_embedded(small, options_of("30g", False))  # kernels are loaded from now on
    for case in CASES[: 2 if quick else None]:
        yield from case_rows(case)


def case_rows(case: Case) -> Iterator[Row]:
    """Plan, write and judge one network."""
    options = options_of(case.needle, case.as_it_is)
    network = case.network(options)
    network = network.moved(-(network.points - network.radius[:, None]).min(axis=0))
    begun = time.process_time()
    try:
        plan = plan_embedded(network, options)
    except DesignError as error:
        yield row(f"{case.name}: planned", 0, "", "a plan", False) | {"refused": str(error)}
        return
    planning_s = time.process_time() - begun
    bore, factor = load(Syringe, SYRINGE).inner_mm, load(Ink, INK).flow_factor
    where: dict[str, Any] = {"place_mm": PLACE_MM, "syringe_bore_mm": bore, "flow_factor": factor}
    with scratch() as folder:
        gcode, table = folder / "embedded.gcode", folder / "network.csv"
        write_network_csv(table, network)
        gcode.write_bytes(gcode_of(plan.toolpath))
        found = judge(gcode, table, options.needle_outer_mm, **where)
    yield limited(f"{case.name}: planning", planning_s, "CPU s", case.planning_s)
    yield from judged_rows(case, options, plan.report, found)


def judged_rows(case: Case, options: EmbeddedOptions, said: Any, found: Row) -> Iterator[Row]:
    """Yield what the checker found, beside what the plan says of itself."""
    name = case.name
    elsewhere = {"not_at_own_overlaps": found["bad_moves_elsewhere"], "bad": found["bad"]}
    yield limited(f"{name}: moves through written ink", found["bad_moves"], "", 0) | elsewhere
    unnamed = [one for one in found["open"] if not (case.names and _named(one, said))]
    count = {key: found[key] for key in ("joints", "joints_open", "cuts", "cuts_open")}
    yield limited(f"{name}: open joints that the plan doesn't name", len(unnamed), "", 0) | count
    yield limited(f"{name}: passes", found["passes"], "", case.passes)
    if said.left_out:
        yield row(f"{name}: vessels left out by name", len(said.left_out))
    least, most = found["speed_least_mm_s"], found["speed_most_mm_s"]
    low, high = options.min_speed_mm_s, options.write_speed_mm_s
    within = low * 0.999 <= least and most <= high * 1.001
    yield row(f"{name}: slowest writing", least, "mm/s", f"{low:g} to {high:g}", within)
    error = found["volume_error_percent"]
    if said.left_out:
        error = 100 * ((found["written_ul"] - found["overlap_ul"]) / said.design_ul - 1)
    yield row(f"{name}: volume against design", error, "%", "within 1", abs(error) <= 1)


def _named(joint: dict[str, Any], plan: Any) -> bool:
    """Return whether a plan names a weak joint near an open one, or a vessel as left out."""
    if set(joint["vessels"]) & {one.vessel for one in plan.left_out}:
        return True
    weak = [one.place_mm for one in (*plan.shortened, *plan.open)]
    return any(np.linalg.norm(np.subtract(joint["at_mm"], place)) < NEAR_MM for place in weak)


def options_of(needle: str, as_it_is: bool) -> EmbeddedOptions:
    """Return a recipe's defaults for a needle; open joints are counted, not refused."""
    bore, ink, printer = load(Needle, needle), load(Ink, INK), load(Printer, PRINTER)
    given = EmbeddedOptions(
        needle_inner_mm=bore.inner_mm, needle_outer_mm=bore.outer_mm, retract_ul=ink.retract_ul,
        plunger_ul_s=ink.plunger_ul_s, open_joints=1_000_000,
        lift_speed_mm_s=float(printer.max_speed_mm_s.z),
    )  # fmt: skip
    return replace(given, **AS_IT_IS) if as_it_is else given


def gcode_of(toolpath: Toolpath) -> bytes:
    """Write a plan for the printer of all cases."""
    ink, printer = load(Ink, INK), load(Printer, PRINTER)
    writer = GcodeOptions(
        start_mm=(100.0, 100.0, 120.0), travel_speed_mm_s=20.0, relieve_ul=ink.retract_ul,
        plunger_ul_s=ink.plunger_ul_s, flow_factor=ink.flow_factor,
    )  # fmt: skip
    return write_gcode(toolpath, printer, load(Syringe, SYRINGE), PLACE_MM, writer).data
