"""X-CAVATE's networks for the Skylar-Scott lab's rig, in both Aerotech dialects.

Judged by `benchmarks.checkers.aerotech` and `benchmarks.checkers.embedded_judge`, which share no
code with the product. Two inks are held against the lab's own file, counted by the same reader.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from benchmarks.checkers.aerotech import Program, read_program
from benchmarks.checkers.embedded_ink import read_axes
from benchmarks.checkers.embedded_judge import judge_moves
from benchmarks.common import DATA, Row, all_of, limited, needed, row, scratch
from benchmarks.embedded.write import options_of
from design.network import VesselKind, VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.network_files.xcavate import read_network_xcavate
from design.toolpath.embedded import EmbeddedHeads, plan_embedded
from design.toolpath.gcode import GcodeOptions, HeadLoad, write_gcode
from firmware_profiles import Printer, Syringe, load

NETWORKS: Final = ("4", "9", "14", "cnet_100", "61_vessels_multimaterial", "500")
RIGS: Final = {"a3200": "stanford_two_heads", "automation1": "stanford_two_heads_automation1"}
TWO_INKS: Final = "61_vessels_multimaterial"
PLACE_MM: Final = (-12.0, -12.0, 5.0)
START_MM: Final = (0.0, 0.0, 60.0)
FLOW_UL_S: Final = 0.05
APART_MM: Final = 103.0
PRINT_MM_S, JOG_MM_S, DWELL_S = 1.0, 5.0, 0.08
"""Speeds at which the lab's report counts its files."""
NEAR_MM: Final = 0.1
"""A point of a vessel is written where the path comes so near, or within its radius."""
MOVE_MM: Final = 0.001
"""Each move tells its ink's radius by itself: what flows follows from its time, which is exact."""
WRITTEN_SHARE: Final = 0.95
MANUAL: Final = frozenset({"G71", "G76", "G4", "WAIT", "Disable"})
"""Words that aren't in the lab's files, and stand in the A3200's manual: mm, seconds, a dwell in
seconds, a wait for the end of motion."""


def rows(quick: bool) -> Iterator[Row]:
    """Yield all networks; quick has two small ones."""
    for name in NETWORKS[1:3] if quick else NETWORKS:
        yield from _network_rows(name)


def _network_rows(name: str) -> Iterator[Row]:
    options = options_of("30g", True)
    network = _read(name)
    network = network.moved(-(network.points - network.radius[:, None]).min(axis=0))
    own = np.zeros(network.vessel_count, dtype=np.int64)
    if name == TWO_INKS:
        own = (network.kind == VesselKind.VEIN).astype(np.int64)
    plan = plan_embedded(network, EmbeddedHeads((options, options), own))
    syringe = load(Syringe, "hamilton_1ml")
    held = HeadLoad(syringe, flow_ul_s=FLOW_UL_S)
    writer = GcodeOptions(start_mm=START_MM, heads=(held, held), travel_speed_mm_s=JOG_MM_S)
    with scratch() as folder:
        table = folder / "network.csv"
        write_network_csv(table, network)
        for controller, profile in RIGS.items():
            printer = load(Printer, profile)
            text = write_gcode(plan.toolpath, printer, syringe, PLACE_MM, writer).data.decode()
            program = read_program(text, "//")
            label = f"{name}, {controller}"
            left_out = {one.vessel for one in plan.report.left_out}
            yield from _judged(label, program, network, own, table, options, left_out)
            if controller == "a3200":
                yield from _beside_theirs(label, program, name)


def _read(name: str) -> VesselNetwork:
    path = needed(DATA / f"xcavate_network_{_file(name)}.txt")
    (ends,) = DATA.glob(f"xcavate_inlet_outlet_{_file(name)}*.txt")
    return read_network_xcavate(path, ends).network


def _file(name: str) -> str:
    return name if "vessels" in name else f"{name}_vessels"


def _judged(
    name: str,
    program: Program,
    network: VesselNetwork,
    own: NDArray[np.int64],
    table: Path,
    options: Any,
    left_out: set[int],
) -> Iterator[Row]:
    moves = program.moves(APART_MM, FLOW_UL_S)
    moves = replace(moves, start=moves.start - PLACE_MM, end=moves.end - PLACE_MM)
    found = judge_moves(
        moves, read_axes(table), options.needle_outer_mm, ul_per_e=1.0, window_mm=MOVE_MM
    )
    head = program.head
    count = np.ceil(moves.length / (NEAR_MM / 4)).astype(np.int64) + 1
    of = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(of)) - (np.cumsum(count) - count)[of]) / (count[of] - 1).clip(min=1)
    path = moves.start[of] + share[:, None] * (moves.end - moves.start)[of]
    written = []
    for vessel in range(network.vessel_count):
        points, radius = network.polyline(vessel)
        ends = head == own[vessel]
        away, _ = KDTree(path[ends[of]]).query(points)
        if np.mean(away <= np.maximum(radius, NEAR_MM)) >= WRITTEN_SHARE:
            written.append(vessel)
    yield all_of(f"{name}: vessels written with their ink", len(written), network.vessel_count)
    silent = network.vessel_count - len(left_out.union(written))
    yield limited(f"{name}: vessels neither written nor left out by name", silent, "", 0)
    yield limited(
        f"{name}: shaft through ink, away from the network's own overlaps",
        found["bad_moves_elsewhere"],
        "moves",
        0,
    ) | {"at_own_overlaps": found["bad_moves"] - found["bad_moves_elsewhere"]}
    idle = _lowest_idle(program) - PLACE_MM[2]
    top = float(moves.end[head >= 0, 2].max())
    clear = idle > top
    yield row(f"{name}: lowest idle tip that goes across", round(idle, 3), "mm",
              f"above {top:.3g}", clear)  # fmt: skip


def _lowest_idle(program: Program) -> float:
    """Height of the lowest tip that goes across while the other writes, mm."""
    step = np.diff(program.at, axis=0)
    across = (step[:, :2] != 0).any(axis=1)
    head = program.head
    lowest = np.inf
    for number, axis in ((0, 3), (1, 2)):
        rows = across & (head == number)
        lowest = min(lowest, float(program.at[1:][rows, axis].min(initial=np.inf)))
    return lowest


def _beside_theirs(name: str, program: Program, network: str) -> Iterator[Row]:
    theirs_of = {TWO_INKS: "science_61_vessels_two_inks.txt", "4": "science_4_vessels.txt"}
    if network not in theirs_of:
        return
    theirs = read_program(needed(DATA / "aerotech" / theirs_of[network]).read_text(), ";")
    ours_s, theirs_s = (one.seconds_at(PRINT_MM_S, JOG_MM_S, DWELL_S) for one in (program, theirs))
    label = f"{name}: time over the lab's file's, equal speeds"
    counted = {"seconds": round(ours_s, 1), "theirs": round(theirs_s, 1)}
    yield limited(label, ours_s / theirs_s, "", 0.6 if network == TWO_INKS else None) | counted
    if network == TWO_INKS:
        yield limited(f"{name}: changes of ink", program.changes(), "", 90) | {
            "theirs": theirs.changes()
        }
    unknown = sorted(set(program.words) - set(theirs.words) - MANUAL)
    if network == TWO_INKS:
        yield limited(f"{name}: words neither in the lab's file nor the manual", len(unknown), "",
                      0) | {"words": unknown, "not_ours": sorted(set(theirs.words) -
                                                                 set(program.words))}  # fmt: skip
