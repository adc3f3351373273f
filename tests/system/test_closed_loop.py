"""Closed artery-vein recipe: flow shares of all loops, checked on the exported files."""

import csv
import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from tests.system.cli import ROOT, printctl


@pytest.mark.slow
def test_ring_is_designed_with_balanced_loops(tmp_path: Path) -> None:
    recipe = ROOT / "examples" / "ring_closed_loop.yaml"
    done = printctl("design", recipe, "--out", "ring", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    with (tmp_path / "ring" / "flow.csv").open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    kinds = Counter(row["kind"] for row in rows)
    assert kinds == {"artery": 17, "vein": 17, "connection": 9}
    shares = np.array([float(row["flow_ul_s"]) for row in rows if row["kind"] == "connection"])
    np.testing.assert_allclose(shares, shares.mean(), rtol=1e-9)
    assert report["solid"]["genus"] == report["solid"]["genus_expected"] == 10
    assert report["network"]["diameter_min_mm"] >= 0.4 - 1e-9
