"""Fields of an observed print's files: those that are written are documented, and no others."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from firmware_profiles.yaml_file import read_yaml
from gcode.motion.executed import NO_MOTION
from printctl.inspection import Blob, Gap, LayerFindings, Stretch
from printctl.inspection.values import Shift
from printctl.machine.control.look_book import LookDecision
from printctl.machine.records.states import LinkState
from printctl.observe.deciding.evidence import UnseenPath
from printctl.observe.looks.expected_ink import ExpectedInk, MendedStretch
from printctl.observe.looks.look_evidence import empty_evidence, record_figures, stretch_ends
from printctl.observe.records import POSTPONED_KEY, LookRecord
from registration.devices.camera_frame import Bath
from registration.devices.lens import write_lens
from registration.devices.lens.lens import write_model
from sim.devices.camera.laser_line import write_heights
from sim.devices.scanner.oct import write_live_scan
from tests.printctl.machine.control.bench import ENDS, JOB, LOOKS, Bench, mend, observe, resume
from tests.registration.devices.camera_frame import scene

PAGE = Path(__file__).parents[2] / "docs" / "run_folder.md"
PATH = SimpleNamespace(
    length_mm=5.0, at=lambda along: np.column_stack([100 + along, 80 + 0 * along, 2 + 0.1 * along])
)
INK = cast(ExpectedInk, SimpleNamespace(paths=(PATH,)))
GAP = Gap(0, 1.0, 3.0, (101.0, 80.0), (103.0, 80.0), 0.02, 1e-9)
MADE_BY_OBSERVER = {"about_from": 10, "not_seen": "", "left_mm": 0.1, POSTPONED_KEY: True}


def documented(heading: str) -> set[str]:
    """Names in the first column of the table below a heading."""
    part = PAGE.read_text(encoding="utf-8").split(f"\n### {heading}")[1].split("\n##")[0]
    rows = re.findall(r"^\| (`.*?) \|", part, re.MULTILINE)
    return {name for row in rows for name in re.findall(r"`([^`]+)`", row)}


def names(value: Any, name: str = "") -> set[str]:
    """Names of a JSON value's fields, those of a list's entries as ``name[].field``."""
    if isinstance(value, dict) and value:
        dot = f"{name}." if name else ""
        return {one for key, item in value.items() for one in names(item, f"{dot}{key}")}
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return {one for item in value for one in names(item, f"{name}[]")}
    return {name}


def found() -> dict[str, Any]:
    """Figures of a look with one of each finding."""
    findings = LayerFindings(
        cast(Any, None), (GAP,), (Stretch("thin", 0, 1.0, 2.0, 0.7, 0.05, 1e-6),),
        (Blob("blob", (101.0, 81.0), np.zeros((3, 2)), 0.1, False, 1e-6),), (), 0.9, 0.1, 1.0, 0.9,
        Shift(0.01, 0.02, np.eye(2)), 40, 9.0, None,
    )  # fmt: skip
    evidence = replace(empty_evidence(), unseen=(UnseenPath("vessel 1", GAP, 5.0),), level_mm=2.0)
    mended = asdict(MendedStretch(0, 1.0, 3.0)) | stretch_ends(0, 1.0, 3.0, INK)
    return {**record_figures(findings, evidence, INK), **MADE_BY_OBSERVER, "mended": [mended]}


def test_a_finding_has_its_place_in_the_printers_frame():
    written = found()
    for kind in ("gaps", "unseen", "mended"):
        [one] = written[kind]
        assert one["start_mm"] == pytest.approx([101.0, 80.0, 2.1])
        assert one["end_mm"] == pytest.approx([103.0, 80.0, 2.3])


def test_fields_of_a_look():
    record = LookRecord(1, 2, 3, "", 0.0, "mend", "", found=found(), seconds={"all": 0.1})
    assert names(json.loads(json.dumps(asdict(record)))) == documented("`print/looks")


def test_fields_of_a_journals_looks():
    bench = Bench(JOB, care=LOOKS)
    inserts = {1: {"lines": mend(ENDS[0]), "again": True}}
    observe(bench, inserts, lambda n: LookDecision("pause" if n == 3 else "go_on"), again=(3,))
    bench.when(LinkState.PAUSED, resume)
    bench.run()
    kinds = ("look", "insert", "looked")
    written = {f"{kind}.{name}" for kind in kinds for one in bench.recorded(kind) for name in one}
    assert written == documented("`print/journal.log`")


def test_fields_of_a_lens_and_a_frame(tmp_path):
    frame = scene.frame().under(Bath(surface_z_mm=6.0))
    write_lens(tmp_path / "lens", frame.lens)
    write_model(tmp_path / "frame", frame)
    lens, written = (read_yaml((tmp_path / one).read_text()) for one in ("lens", "frame"))
    assert set(lens) == documented("Lens file")
    assert written["lens"] == lens
    assert names({**written, "lens": None}) == documented("Frame file of a camera")


def test_fields_of_arrays(tmp_path):
    def keys(prefix=""):
        with np.load(tmp_path / "a.npz") as file:
            return {prefix + name for name in file.files}

    NO_MOTION.save(tmp_path / "a.npz")
    assert keys() == documented("`executed.npz`")
    write_heights(tmp_path / "a.npz", np.zeros((2, 2), np.float32), np.eye(4), (20.0, 20.0))
    heights, scan = keys("laser."), "volume voxel_mm refractive_index optical_depth scale modality"
    named = dict.fromkeys([*scan.split(), "depth_down", "pose_truth"], 0)
    write_live_scan(tmp_path / "a.npz", cast(Any, SimpleNamespace(**named)))
    assert heights | keys("oct.") == documented("Height maps")
