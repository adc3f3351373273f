"""Aerotech controllers: every command that would send lines refuses, with the reason."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Printer, Syringe, load
from printctl.checks.preflight.firmware import firmware_checks
from printctl.machine.link.errors import Refused
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.retreat import Retreat
from printctl.machine.printing import Order, find_or_start
from printctl.pipeline.stages import printing
from printctl.recipe.making import FileScan, SimulatedScan
from sim.gcode.dry_run.run import dry_run
from tests.design.toolpath.plans import fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block
from tests.printctl.machine.link.jobs import parse_job

PROFILE = "aerotech_pneumatic"
PRINTER = load(Printer, PROFILE)
START = (50.0, 60.0, 30.0)


def job() -> bytes:
    toolpath = fresh_toolpath(as_solid(block(2, 2, 0.18)), FreshOptions())
    options = GcodeOptions(start_mm=START, flow_ul_s=0.12)
    return write_gcode(toolpath, PRINTER, load(Syringe, "hamilton_1ml"), (60, 70, 20), options).data


def nothing() -> str:
    raise AssertionError("a port was opened")


@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize("port", ["simulated", "/dev/ttyACM0"])
def test_a_print_is_refused_before_a_port_is_looked_for(
    tmp_path: Path, port: str, resume: bool
) -> None:
    file = tmp_path / "part.gcode"
    file.write_bytes(job())
    order = Order(file, PROFILE, port, tmp_path / "print", Retreat(), resume=resume)
    with pytest.raises(Refused, match=r"Load .*part\.gcode in the controller's own software"):
        find_or_start(order, nothing)
    assert [path.name for path in tmp_path.iterdir()] == ["part.gcode"]


def test_its_marks_are_read() -> None:
    data = job()
    found = parse_job(data, "part.gcode", PRINTER)
    layers = [mark.number for mark in found.marks.of(MarkKind.LAYER)]
    assert layers == [0, 1, 2]
    assert not any(line.startswith(b"//") for line in found.lines)
    commands = dry_run(data, PRINTER, START).program.command
    assert len(found) == commands[-1] + 1


def test_preflight_tells_what_is_to_be_seen_to_by_hand() -> None:
    checks = firmware_checks(dry_run(job(), PRINTER, START), PRINTER)
    assert [(check.check, check.weight) for check in checks] == [("asked of you", "warns")]
    assert "load the file in the controller's own software" in checks[0].remedy


def context(folder: Path, scan: Any, said: list[str]) -> Any:
    return SimpleNamespace(
        printer=PRINTER,
        folder=folder,
        scan_part=scan,
        printed=False,
        recipe=SimpleNamespace(printer=SimpleNamespace(port="auto")),
        bars=SimpleNamespace(remark=lambda stage, text: said.append(f"{stage}: {text}")),
    )


def test_a_runs_print_is_left_out_with_a_word_where_the_scan_is_a_file(tmp_path: Path) -> None:
    said: list[str] = []
    scan = FileScan(file="scan.tif")
    summary, files = printing.work(context(tmp_path, scan, said), lambda *_: None)
    assert summary["state"] == "by hand"
    assert not files
    assert len(said) == 1
    assert said[0].startswith("print: left out: Aerotech gantry")
    assert list(tmp_path.iterdir()) == []


def test_a_run_ends_there_where_the_scan_would_be_simulated(tmp_path: Path) -> None:
    scan = SimulatedScan(simulated="oct")
    with pytest.raises(Refused, match="give the scan of the part as a file"):
        printing.work(context(tmp_path, scan, []), lambda *_: None)
