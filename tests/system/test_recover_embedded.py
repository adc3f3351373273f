"""A print of vessels that was broken off: what the rest's needle meets can be looked at."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from design.toolpath.gcode import GcodeOptions, save_gcode, write_gcode
from firmware_profiles import Ink, Printer, Syringe, load
from printctl.checks.preflight import written_arrays
from tests.design.toolpath.shapes import random_tree
from tests.sim_process import printer_process
from tests.system.cli import called

START = (60.0, 60.0, 90.0)
PLACE = np.array([80.0, 80.0, 40.0])
TIP = ",".join(f"{value:g}" for value in START)
UNSEEN = "whether the shaft passes through written vessels wasn't looked at"


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A job of vessels whose printer was reset in mid-print."""
    folder = tmp_path_factory.mktemp("job")
    net, options = random_tree(12, 12.0, 3, 0.1), EmbeddedOptions(open_joints=99)
    flow = load(Ink, "gelatin_sacrificial").flow_factor
    made = write_gcode(
        plan_embedded(net, options).toolpath,
        load(Printer, "generic_marlin"),
        load(Syringe, "hamilton_1ml"),
        PLACE,
        GcodeOptions(start_mm=START, flow_factor=flow),
    )
    needle = (options.needle_outer_mm, options.needle_outer_mm, 0.0)
    beside = written_arrays(net, PLACE, options.overlap_radii, options.clearance_mm, [needle])
    job = folder / "job.gcode"
    save_gcode(job, folder / "job.map.npz", [made], beside)
    given = ("--printer", "generic_marlin", "--start", TIP, "--yes", "--checkpoint-every", "0")
    cut = made.line_count // 2
    with printer_process(
        folder, "--exit-on-hangup", "--start", TIP, "--fault", f"reset@{cut}"
    ) as port:
        done = called("print", job, "--port", port, *given, cwd=folder)
    assert done.returncode == 4, done.stderr
    return job


def rest_of(job: Path, *more: str) -> dict[str, object]:
    done = called("recover", job, "--yes", "--json", *more, cwd=job.parent)
    assert done.returncode == 0, done.stderr
    found: dict[str, object] = json.loads(done.stdout)
    return found


def test_rest_has_the_map_of_its_lines_and_its_shaft_is_checked(broken: Path) -> None:
    rest = Path(str(rest_of(broken)["file"]))
    job, lines = broken.read_text().splitlines(), rest.read_text().splitlines()
    title = re.search(r"from its line (\d+)", lines[0])
    assert title is not None
    kept = len(job) + 1 - int(title[1])
    assert lines[-kept:] == job[-kept:]
    assert sources(rest)[-kept:] == sources(broken)[-kept:]
    assert set(sources(rest)[:-kept]) == {-1}
    assert kept > 30
    checked = called(
        "simulate", rest, "--printer", "generic_marlin", "--start", TIP, cwd=rest.parent
    )
    assert checked.returncode == 0, checked.stderr
    assert UNSEEN not in checked.stdout + checked.stderr
    assert "moves looked at" in checked.stdout + checked.stderr


def test_of_vessels_written_twice_it_says_where_the_needle_does_least_harm(broken: Path) -> None:
    plan = rest_of(broken)
    told = " ".join(plan["steps"])  # type: ignore[arg-type]
    line = re.search(r"It does so least with --from-line (\d+)", told)
    assert "passed through by the needle" in told
    assert line is not None
    later = rest_of(broken, "--from-line", line[1])
    assert int(str(later["lines_left_out"])) > int(str(plan["lines_left_out"]))
    assert "It does so least" not in " ".join(later["steps"])  # type: ignore[arg-type]


def test_a_map_of_another_job_is_not_handed_on(broken: Path) -> None:
    own = broken.with_suffix(".map.npz")
    kept = own.read_bytes()
    rest = Path(str(rest_of(broken)["file"])).with_suffix(".map.npz")
    assert rest.is_file()
    with np.load(own) as found:
        arrays = {name: found[name] for name in found.files}
    try:
        np.savez(own, **arrays | {"source": arrays["source"][1:]})
        rest_of(broken)
        assert not rest.is_file()
    finally:
        own.write_bytes(kept)


def sources(job: Path) -> list[int]:
    with np.load(job.with_suffix(".map.npz")) as found:
        numbers: list[int] = found["source"].tolist()
    return numbers
