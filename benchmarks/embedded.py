"""Embedded writing: shaft collisions, joints, passes, time, volume: ``make bench-embedded``.

The G-code is judged by `benchmarks.checkers.embedded_judge`, which shares no code with the product.
X-CAVATE's networks come from the folder that PRINTCTL_SHARED_DATA names; rows of files that aren't
there are left out. ``--only NAME`` measures one network; ``--quick`` leaves the 2,000 vessels and
the way through the command line out.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers.embedded_judge import judge
from benchmarks.command import Job, Row, run
from benchmarks.embedded_cases import (
    PLACE_MM,
    Z_MM_S,
    Case,
    Written,
    grown,
    loops,
    lowered,
    options_of,
    shared_network,
    warm,
    write,
)
from benchmarks.machine import row
from design.errors import DesignError
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv

QUOTED = "X-CAVATE (MIT), quoted from issue 7, not run here: PyPI has no xcavate"
SLOW_LIFT_S = 2.0
"""X-CAVATE's after each pass: 0.5 mm at 0.25 mm/s, in the G-code that its repository holds."""
NEAR_MM = 0.5
"""A joint that the checker finds open is the one that the plan names so near to it."""
JOG_MM_S = 10.0
"""X-CAVATE's on the way up, across and down, in the same file."""
RECIPE = """schema: 1
name: door
seed: 1
tissue: {{shape: block, size_mm: [{0:.1f}, {1:.1f}, {2:.1f}]}}
vasculature: {{network: network.csv, unit: mm, overlaps: tell}}
toolpath: {{method: embedded, needle: 30g_50mm, allowed_crossings: 1000000}}
printer: {{ink: gelatin_sacrificial, bath: cell_matrix, place_mm: [{3}, {4}, {5}]}}
"""

PEER_500 = {
    "network": "another one, of its own, of 500 vessels",
    "passes": 2905,
    "bad_passes": 168,
    "planning_s": 10.9,
    "speed_mm_s": [0.23, 64],
}

CASES = (
    Case("4", "30g", lambda _: shared_network("4"), None, None, "X-CAVATE's, cm to mm as it comes"),
    Case(
        "14",
        "30g",
        lambda _: shared_network("14"),
        30,
        0.5,
        "X-CAVATE's, cm to mm as it comes: diameters 0.44 to 1.6 mm, within the needle's limits",
        peer={"passes": 55, "bad_passes": 6},
    ),
    Case(
        "100",
        "30g",
        lambda _: shared_network("cnet_100"),
        260,
        2.0,
        "X-CAVATE's CNET, cm to mm as it comes: diameters 0.31 to 2.2 mm; its vessels overlap each "
        "other beside joints",
        peer={"passes": 370, "bad_passes": 20},
    ),
    Case(
        "500_22g",
        "22g",
        partial(grown, size_mm=(60.0, 60.0, 45.0)),
        1000,
        8.0,
        "grown in 60 x 60 x 45 mm: from 0.8 of the needle's bore up, walls as its tip needs",
        names=True,
        peer=PEER_500,
    ),
    Case(
        "500_30g",
        "30g",
        partial(grown, size_mm=(40.0, 40.0, 30.0)),
        1000,
        8.0,
        "grown in 40 x 40 x 30 mm: from 0.8 of the needle's bore up, walls as its tip needs",
        names=True,
        peer=PEER_500,
    ),
    Case(
        "as_it_is_30g",
        "30g",
        lambda _: shared_network("500"),
        1200,
        8.0,
        "X-CAVATE's 500 vessels, cm to mm as it comes: diameters from 0.06 mm; what can't be "
        "written in any order is left out and named",
        names=True,
        as_it_is=True,
    ),
    Case(
        "as_it_is_22g",
        "22g",
        lambda _: shared_network("500"),
        1200,
        8.0,
        "the same with a needle of 0.72 mm",
        names=True,
        as_it_is=True,
    ),
    Case(
        "loops_2000",
        "30g",
        lambda _: loops(401),
        None,
        120.0,
        "artery and vein of 401 terminals each in a ring of 60 x 30 mm, joined to loops",
        names=True,
        slow=True,
    ),
)


def rows(case: Case, quick: bool) -> Iterator[Row]:
    """Everything about one network."""
    if case.slow and quick:
        return
    print(f"{case.name}: network", file=sys.stderr, flush=True)
    network = case.network(options_of(case.needle, case.as_it_is))
    if network is None:
        print(f"{case.name}: its file isn't there (PRINTCTL_SHARED_DATA)", file=sys.stderr)
        return
    network = lowered(network)
    warm()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_network_csv(folder / "network.csv", network)
        try:
            written = write(network, case, folder, 1 if case.slow else 3)
        except DesignError as exc:
            yield row(f"{case.name}: planned", 0, "", "a plan", False) | {"refused": str(exc)}
            return
        found = _judge(folder, written)
        yield from _judged(case, network, written, found)
        yield _time(case, _called(case), network, found, Z_MM_S)
        if case.name == "14" and not quick:
            yield _door(network, written, folder)
        if case.peer:
            faster = write(network, case, folder, 1, z_mm_s=JOG_MM_S)
            yield _time(case, _called(case), network, _judge(folder, faster), JOG_MM_S)


def _called(case: Case) -> str:
    return f"{case.name} vessels" if case.name.isdigit() else case.name


def _judge(folder: Path, written: Written) -> dict[str, Any]:
    return judge(
        written.gcode,
        folder / "network.csv",
        written.options.needle_outer_mm,
        place_mm=PLACE_MM,
        syringe_bore_mm=written.bore_mm,
        flow_factor=written.flow_factor,
    )


def _judged(
    case: Case, network: VesselNetwork, written: Written, found: dict[str, Any]
) -> Iterator[Row]:
    name, options = _called(case), written.options
    peer = {"what": QUOTED, **case.peer} if case.peer else None
    about = {
        "network": case.about,
        "vessels": network.vessel_count,
        "needle_mm": [options.needle_inner_mm, options.needle_outer_mm],
    }
    bad = ("bad_moves_elsewhere", "bad_writing", "bad_travels", "bad_passes", "bad")
    yield (
        row(f"{name}: bad moves", found["bad_moves"], "", "0", found["bad_moves"] == 0, peer)
        | about
        | {key: found[key] for key in bad}
    )
    elsewhere = found["bad_moves_elsewhere"]
    if elsewhere < found["bad_moves"]:
        yield row(
            f"{name}: bad moves but where the network overlaps itself",
            elsewhere,
            "",
            "0",
            elsewhere == 0,
        )
    unclosed = found["joints_open"] + found["cuts_open"]
    unnamed = [one for one in found["open"] if not _named(one, written.said)]
    rest, goal = (len(unnamed), "0 that the plan doesn't name") if case.names else (unclosed, "0")
    yield (
        row(f"{name}: open joints", unclosed, "", goal, rest == 0)
        | {key: found[key] for key in ("joints", "joints_open", "cuts", "cuts_open", "open")}
        | {"unnamed": len(unnamed)}
    )
    yield _limited(f"{name}: passes", found["passes"], "", case.passes)
    yield _limited(f"{name}: planning, CPU", round(written.planning_s, 3), "s", case.planning_s)
    if written.said.left_out:
        yield row(f"{name}: vessels left out by name", len(written.said.left_out), "") | {
            "cut_off": len(written.said.cut_off)
        }
    least, most = found["speed_least_mm_s"], found["speed_most_mm_s"]
    low, high = options.min_speed_mm_s, options.write_speed_mm_s
    within = low * 0.999 <= least and most <= high * 1.001
    goal = f"{low:g} to {high:g}"
    yield row(f"{name}: speed, slowest", least, "mm/s", goal, within) | {"fastest_mm_s": most}
    error = found["volume_error_percent"]
    if written.said.left_out:
        error = 100 * ((found["written_ul"] - found["overlap_ul"]) / written.said.design_ul - 1)
    keys = ("design_ul", "written_ul", "overlap_ul", "beside_ul", "radius_error_p1_p99_percent")
    yield row(
        f"{name}: volume without overlaps against design", error, "%", "within 1", abs(error) <= 1
    ) | {key: found[key] for key in keys}


def _named(joint: dict[str, Any], plan: Any) -> bool:
    """Whether a plan names a weak joint near an open one, or a vessel there as left out."""
    if set(joint["vessels"]) & {one.vessel for one in plan.left_out}:
        return True
    weak = [one.place_mm for one in (*plan.shortened, *plan.open)]
    return any(np.linalg.norm(np.subtract(joint["at_mm"], place)) < NEAR_MM for place in weak)


def _limited(measure: str, value: float, unit: str, most: float | None) -> Row:
    if most is None:
        return row(measure, value, unit)
    return row(measure, value, unit, f"<= {most:g}", value <= most)


def _time(
    case: Case, name: str, network: VesselNetwork, found: dict[str, Any], z_mm_s: float
) -> Row:
    """Time at constant speeds, and of the peer on the same printer, whose z goes so fast."""
    parts = ("writing_s", "travel_s", "lift_s", "plunger_s", "dwell_s")
    more = {key: round(found[key], 1) for key in parts}
    measure = f"{name}: total time at constant speeds, z at most {z_mm_s:g} mm/s"
    total = round(found["total_s"], 1)
    if not case.peer or case.peer.get("network"):
        return row(measure, total, "s") | more
    # At least: what it travels across, and its pressure's pauses, are left out.
    start, end, *_ = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    middle = (start + end)[:, 2] / 2
    rise = float(network.points[:, 2].max() - (length * middle).sum() / length.sum())
    jog = min(JOG_MM_S, z_mm_s)
    lifts = case.peer["passes"] * (SLOW_LIFT_S + 2 * rise / jog)
    peer = {
        "what": f"{QUOTED}; its passes times its slow lift of {SLOW_LIFT_S:g} s and the way to "
        f"the top and back, {rise:.1f} mm on average, at {jog:g} mm/s; writing as here",
        "total_s": round(found["writing_s"] + lifts, 1),
        "lifts_s": round(lifts, 1),
    }
    if case.name != "100":
        return row(measure, total, "s", peer=peer) | more
    limit = peer["total_s"] / 3
    return (
        row(measure, total, "s", f"<= {limit:.1f}, a third of the peer's", total <= limit, peer)
        | more
    )


def _door(network: VesselNetwork, written: Written, folder: Path) -> Row:
    """Whether `printctl toolpath` writes the same moves for the same network."""
    size = (network.points + network.radius[:, None]).max(axis=0) + 0.1
    (folder / "door.yaml").write_text(RECIPE.format(*size, *PLACE_MM))
    out = folder / "door.gcode"
    words = ["toolpath", str(folder / "door.yaml"), "--out", str(out)]
    done = subprocess.run(
        [sys.executable, "-m", "printctl", *words], capture_output=True, text=True, check=False
    )
    same = out.is_file() and _ways(out) == _ways(written.gcode)
    found = row("14 vessels: the same moves from `printctl toolpath`", int(same), "", "1", same)
    return found if done.returncode == 0 else found | {"refused": done.stderr[-500:]}


def _ways(gcode: Path) -> list[str]:
    """Lines of a file that write."""
    return [line for line in gcode.read_text().splitlines() if line.startswith("G1 X")]


JOBS: dict[str, Job] = {case.name: partial(rows, case) for case in CASES}


if __name__ == "__main__":
    run(JOBS, __doc__)
