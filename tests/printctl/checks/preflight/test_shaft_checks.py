"""Job with shaft collisions: refused unless confirmed, which the journal records."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from design.network import VesselNetwork
from design.toolpath import Toolpath
from design.toolpath.embedded import Bundles, EmbeddedOptions, bundled, plan_embedded
from design.toolpath.gcode import Gcode, GcodeOptions, save_gcode, stream_gcode, write_gcode
from design.toolpath.toolpath import MoveBuilder
from firmware_profiles import Ink, Printer, Syringe, load
from gcode.dry_run.run import dry_run
from printctl.checks.preflight import shaft_clearance, written_arrays
from printctl.checks.preflight.shaft import read_written_arrays
from printctl.checks.set_up import HeadLoading
from printctl.errors import SafetyError
from printctl.machine.records.replay import read_journal
from printctl.pipeline.running.run import toolpath_recipe
from printctl.pipeline.stages.paths import toolpath as stage
from printctl.recipe import parse_recipe
from tests.design.toolpath.random_networks import random_network
from tests.design.toolpath.shapes import random_tree
from tests.printctl.networks import network_recipe, vessels
from tests.slower import first_of, first_rows
from tests.system.cli import called, printctl

HIGH, LOW = [(1, 3, 4), (9, 3, 4)], [(5, 1, 2), (5, 5, 2)]
RADIUS = 0.2
NEEDLE = (0.31, 0.31, 0.0)
"""Outer diameter, its tip's, and the height of its cone."""
SIDE = np.array([[1, 3, 4], [9, 3, 4], [1, 3.375, 3], [9, 3.375, 3]], dtype=float)
"""0.02 mm beside what a 30G needle needs."""
PLACE, START = (95.0, 97.0, 5.0), (100.0, 100.0, 20.0)
NETWORK = vessels(HIGH, LOW, radius=RADIUS, tree=[0, 1])


def written(*order: int, lines: Any = (HIGH, LOW)) -> Toolpath:
    """Both vessels, 0 above 1, one after the other."""
    points = [np.array(line, dtype=float) for line in lines]
    builder = MoveBuilder(points[order[0]][0], "vessel")
    for vessel in order:
        begin, end = points[vessel]
        if not np.array_equal(builder.tip, begin):
            above = [[*builder.tip[:2], 8.0], [*begin[:2], 8.0], begin]
            builder.travel(np.array(above, dtype=float), 5.0, vessel)
        volume = np.pi * RADIUS**2 * np.linalg.norm(end - begin)
        builder.write(end[None], np.array([volume]), 5.0, vessel)
    return builder.build()


def job(
    folder: Path, *order: int, points: Any = (HIGH, LOW), network: VesselNetwork = NETWORK
) -> Path:
    """A G-code file and its map."""
    path = folder / "part.gcode"
    toolpath, options = written(*order, lines=points), GcodeOptions(start_mm=START)
    made = write_gcode(toolpath, PRINTER, SYRINGE, PLACE, options)
    beside = written_arrays(network, np.array(PLACE), 0.5, 0.05, [NEEDLE])
    save_gcode(path, path.with_suffix(".map.npz"), [made], beside)
    return path


def simulated(folder: Path, *more: str) -> Any:
    file = folder / "part.gcode"
    return called("simulate", file, "--start", "100,100,20", *more, cwd=folder)


def test_a_planted_crossing_refuses_and_says_which(tmp_path: Path) -> None:
    file = job(tmp_path, 0, 1)
    done = simulated(tmp_path)
    assert done.returncode == 3
    lines = file.read_text().splitlines()
    under = next(k for k, text in enumerate(lines, 1) if "Y102 E" in text)
    assert f"line {under} (write for vessel 1) drives the shaft 0.35" in done.stderr
    assert "into vessel 0" in done.stderr
    assert "x 100.0" in done.stderr
    assert "--accept-crossings" in done.stderr


def test_the_other_way_round_passes_and_tells_how_near_it_came(tmp_path: Path) -> None:
    job(tmp_path, 1, 0)
    done = simulated(tmp_path, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["clearance"]
    assert found["crossings"] == 0
    assert found["nearest_apart_mm"] is None  # 2 mm above


def test_the_clearance_warns_and_doesnt_refuse(tmp_path: Path) -> None:
    job(tmp_path, 1, 0)
    done = simulated(tmp_path, "--json")
    graze = next(c for c in json.loads(done.stdout)["checks"] if "within 0.05" in c["check"])
    assert graze["passed"]
    beside = replace(NETWORK, nodes=SIDE, points=SIDE[[0, 1, 2, 3]])
    job(tmp_path, 0, 1, points=[SIDE[:2], SIDE[2:]], network=beside)
    done = simulated(tmp_path)
    assert done.returncode == 0, done.stderr
    assert re.search(r"takes the shaft past vessel 0 at 0\.0[12]\d mm", done.stderr)
    assert "line " in done.stderr


def test_the_needle_that_is_mounted_counts(tmp_path: Path) -> None:
    job(tmp_path, 0, 1)
    wide = simulated(tmp_path, "--needle", "22g")
    depth = re.search(r"shaft (\S+) mm into vessel 0", wide.stderr)
    assert depth is not None
    assert float(depth[1]) == pytest.approx(0.36 + RADIUS, abs=0.003)


def test_a_map_of_another_file_is_no_proof(tmp_path: Path) -> None:
    file = job(tmp_path, 1, 0)
    file.write_text(file.read_text() + "G0 X100\n")
    done = simulated(tmp_path)
    assert done.returncode == 2
    assert "belongs to another job" in done.stderr
    file.with_suffix(".map.npz").write_bytes(b"nothing")
    done = simulated(tmp_path)
    assert done.returncode == 2
    assert "can't be checked" in done.stderr


def test_without_a_map_writing_on_a_slope_is_told_to_be_unchecked(tmp_path: Path) -> None:
    file = tmp_path / "part.gcode"
    head = "G21\nG90\nM82\nM302 P1\nG92 X100 Y100 Z20 E0\nG1 X105 E0.02 F600\n"
    file.write_text(head + "G1 X100 Z21 E0.04\nM400\n")
    assert "weren't checked" in simulated(tmp_path).stderr
    file.write_text(head + "G1 X100 E0.04\nM400\n")
    assert "shaft" not in simulated(tmp_path).stderr


def test_print_refuses_until_it_is_accepted_and_then_the_journal_keeps_it(tmp_path: Path) -> None:
    file = job(tmp_path, 0, 1)
    words = ("print", file, "--printer", "generic_marlin", "--port", "simulated")
    words += ("--ink", "gelatin_sacrificial", "--start", "100,100,20", "--json")
    refused = called(*words, cwd=tmp_path)
    assert refused.returncode == 3
    assert not (tmp_path / "part.gcode.print").exists()
    done = printctl(*words, "--accept-crossings", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "vessel 0" in done.stderr
    (kept,) = read_journal(tmp_path / "part.gcode.print" / "journal.log").job["accepted"]
    assert "moves that cross 1 pairs of vessels" in kept


@dataclass(frozen=True)
class NoReport:
    """Of a path that nobody planned."""

    passes: int = 2


@pytest.mark.parametrize("allowed", first_of([0, 1]))
def test_a_run_refuses_what_its_recipe_doesnt_allow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, allowed: int
) -> None:
    path = written(0, 1)
    own = Bundles.plain(NETWORK)
    planned = stage.PlannedPath([path], 8.0, lambda: NoReport(), own)  # type: ignore[arg-type, return-value]
    monkeypatch.setattr(stage, "plan", lambda _: planned)
    toolpath = {"method": "embedded", "needle": "30g", "allowed_crossings": allowed}
    ink = {"ink": "gelatin_sacrificial", "bath": "cell_matrix"}
    recipe = network_recipe(tmp_path, NETWORK, (10, 6, 6), toolpath=toolpath, printer=ink)
    made = parse_recipe(recipe, "planted.yaml")

    def run() -> dict[str, Any]:
        return toolpath_recipe(made, tmp_path, tmp_path / "run", Console(quiet=True))

    if not allowed:
        with pytest.raises(SafetyError, match=r"line \d+ \(write for vessel 1\) drives"):
            run()
    else:
        found = run()["dry_run"]
        assert "1 pairs" in found["accepted_crossings"]
        told = next(c for c in found["checks"] if "crossed by" in c["check"])
        assert (told["passed"], told["weight"]) == (False, "warns")
    kept = json.loads((tmp_path / "run" / "dry_run.json").read_text())["clearance"]
    assert kept["crossing"][0]["crossed"] == 0


# --- planned embedded jobs pass the shaft checker, except where the plan reports it
START_SHAFT_PLANS = (60.0, 60.0, 90.0)
PRINTER, SYRINGE = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")
SACRIFICIAL = load(Ink, "gelatin_sacrificial")
PLACE_SHAFT_PLANS = np.array([80.0, 80.0, 40.0])
SHALLOW_MM = 0.02
"""The plan looks at three places of each element: what it calls a graze may be so deep."""


def checked(made: Gcode, beside: dict[str, Any], start_mm: tuple[float, float, float]) -> Any:
    """What the check of shafts finds in a job that was written with arrays of its ink."""
    lines = {"source": made.line_source, "kind": made.line_kind}
    arrays = read_written_arrays(lines | beside)
    run = dry_run(made.data, PRINTER, start_mm)
    return shaft_clearance(run, PRINTER, [HeadLoading(SYRINGE, SACRIFICIAL, None)], arrays)


@pytest.mark.parametrize("seed", first_of(range(8), 2))
def test_the_checker_flags_nothing_that_a_plan_of_a_tree_doesnt_tell(seed: int) -> None:
    options = EmbeddedOptions(overlap_radii=0.5, open_joints=99)
    net = random_tree(4 + 3 * seed, 12.0, seed, 0.1)
    plan = plan_embedded(net, options)
    writer = GcodeOptions(start_mm=START_SHAFT_PLANS, flow_factor=SACRIFICIAL.flow_factor)
    made = write_gcode(plan.toolpath, PRINTER, SYRINGE, PLACE_SHAFT_PLANS, writer)
    beside = written_arrays(
        net, PLACE_SHAFT_PLANS, options.overlap_radii, options.clearance_mm, [NEEDLE]
    )
    found = checked(made, beside, START_SHAFT_PLANS)
    told = {frozenset((one.vessel, one.through)) for one in plan.report.crossings}
    deep = {frozenset((a.vessel, a.crossed)) for a in found.crossings if a.depth_mm > SHALLOW_MM}
    assert deep <= told
    assert found.summary()["written_pieces"] > len(net.vessel_nodes)


@pytest.mark.parametrize(
    ("seed", "size_mm"), first_rows([(0, 12.0), (0, 20.0), (1, 20.0), (2, 20.0), (3, 20.0)])
)
def test_bundles_pass_the_checker_but_for_what_the_plan_tells(seed: int, size_mm: float) -> None:
    options = EmbeddedOptions(overlap_radii=0.5, open_joints=99)
    net = random_tree(5 + 2 * seed, size_mm, seed, 0.3)
    made = bundled(net, np.full(net.vessel_count, 1.2 * float(net.radius.max())))
    assert not made.is_plain
    plan = plan_embedded(made, options)
    told = GcodeOptions(start_mm=START_SHAFT_PLANS, flow_factor=SACRIFICIAL.flow_factor)
    beside: dict[str, Any] = {}
    job = stream_gcode(
        [plan.toolpath], PRINTER, SYRINGE, PLACE_SHAFT_PLANS, told, plan.toolpath.top_mm
    )
    whole = Gcode.joined(list(made.of_design(job, beside)))
    strands = np.bincount(made.owner) > 1
    beside |= written_arrays(net, PLACE_SHAFT_PLANS, options.overlap_radii, 0.05, [NEEDLE], strands)
    found = checked(whole, beside, START_SHAFT_PLANS)
    named = {frozenset((one.vessel, one.through)) for one in plan.report.crossings}
    deep = {frozenset((a.vessel, a.crossed)) for a in found.crossings if a.depth_mm > SHALLOW_MM}
    assert deep <= named
    assert found.summary()["written_pieces"] > len(made.owner)


# --- embedded plan's own collision report agrees with the check of its G-code
START_PLAN_AND_CHECK = (60.0, 60.0, 190.0)
PLACE_PLAN_AND_CHECK = np.array([80.0, 80.0, 40.0])
ROUNDED_MM = 0.002
"""G-code's rounding: what lies so near to the depth that is a crossing may be told by one alone."""
TOUCH_MM = 0.005


def said_and_seen(seed: int) -> tuple[dict[tuple[int, int], float], dict[tuple[int, int], float]]:
    """Pairs of vessels that cross, with the depth: by the plan, and by the check."""
    net, needle = random_network(seed)
    outer, tip, cone = needle
    options = replace(
        EmbeddedOptions(overlap_radii=0.5),
        open_joints=9999,
        needle_inner_mm=0.1,
        needle_outer_mm=outer,
        tip_outer_mm=tip if cone else 0.0,
        cone_mm=cone,
    )
    plan = plan_embedded(net, options)
    writer = GcodeOptions(start_mm=START_PLAN_AND_CHECK, flow_factor=SACRIFICIAL.flow_factor)
    made = write_gcode(plan.toolpath, PRINTER, SYRINGE, PLACE_PLAN_AND_CHECK, writer)
    beside = written_arrays(
        net, PLACE_PLAN_AND_CHECK, options.overlap_radii, options.clearance_mm, [needle]
    )
    found = checked(made, beside, START_PLAN_AND_CHECK)
    seen: dict[tuple[int, int], float] = {}
    for one in found.crossings:
        assert one.vessel is not None
        assert one.crossed is not None
        pair = one.vessel, one.crossed
        seen[pair] = max(seen.get(pair, 0.0), one.depth_mm)
    return {(one.vessel, one.through): one.depth_mm for one in plan.report.crossings}, seen


def agrees(seed: int) -> bool:
    """Whether both say that the job crosses ink, or both that it doesn't."""
    said, seen = said_and_seen(seed)
    if bool(said) == bool(seen):
        return True
    return max([*said.values(), *seen.values()]) < TOUCH_MM + ROUNDED_MM


@pytest.mark.parametrize("seed", first_of([20, 287, 437, 817, 4, 35, 41, 56, 966, *range(6)], 4))
def test_plan_and_check_agree_on_whether_a_job_crosses_ink(seed: int) -> None:
    """4, 20, 35, 41 and 56 differed while the plan looked at places of elements alone.

    In 817 and 966 one line of G-code writes a short vessel and goes on past its end; in 437 a pass
    cut within a vessel goes on straight where the vessel bends. In 287 a bend lies where a joint
    ends, to the rounding of G-code.
    """
    assert agrees(seed)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(60))
def test_plan_and_check_agree_on_three_thousand_networks(block: int) -> None:
    assert [seed for seed in range(50 * block, 50 * block + 50) if not agrees(seed)] == []
