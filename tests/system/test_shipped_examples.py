"""Shipped examples with a scan pass as they are, or fail in nothing where some can't be decided."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.system.cli import ROOT, printctl

ELSEWHERE = {"planar_fresh", "cortex_embedded", "cube_multifidelity"}
"""The first two have tests of their own. The third takes ten minutes for its flow; where its loop
closes lumens come out 15 to 30 % too wide, so that its verdict is undecided."""
UNDECIDED = {"ring_two_inks"}
"""One lumen of 43 is 7.5 ± 2.6 % too wide where two passes meet, for a limit of 10 %."""

NAMES = sorted(
    path.stem
    for path in (ROOT / "examples").glob("*.yaml")
    if "\nscan:" in path.read_text(encoding="utf-8") and path.stem not in ELSEWHERE
)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_example_passes(name: str, tmp_path: Path) -> None:
    done = printctl("run", ROOT / "examples" / f"{name}.yaml", "--out", "run", cwd=tmp_path)
    report = tmp_path / "run" / "report.json"
    assert report.is_file(), done.stderr
    data = json.loads(report.read_text())
    reasons = data["verdict"]["reasons"]
    if name not in UNDECIDED:
        assert done.returncode == 0, reasons
        return
    decisions = [vessel["decision"] for vessel in data["registration"]["vessels"]]
    assert decisions.count("pass") >= len(decisions) - 1, reasons
    assert "fail" not in decisions, reasons
