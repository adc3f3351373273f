"""Gaps planned into the jobs of two examples."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from design.network_files.csv_format import read_network_csv
from firmware_profiles import Ink, Needle, Printer, Syringe, load
from printctl.machine.link.job import load_job
from printctl.machine.link.marks import MarkKind
from printctl.observe.mending import (
    Gap,
    HeldPrint,
    Voids,
    check_mend,
    plan_mend,
    written_paths,
)

ROOT = Path(__file__).parents[4]


def planned(folder, name):
    words = [
        sys.executable,
        "-m",
        "printctl",
        "run",
        f"examples/{name}.yaml",
        "--until",
        "toolpath",
    ]
    subprocess.run([*words, "--out", str(folder)], cwd=ROOT, check=True, capture_output=True)
    return load_job(folder / "part.gcode", load(Printer, "generic_marlin"))


def held_at(job, mark, ink, needle):
    parts = load(Syringe, "hamilton_1ml"), load(Ink, ink), load(Needle, needle)
    return HeldPrint(job.lines, mark.index, load(Printer, "generic_marlin"), *parts)


@pytest.mark.slow
def test_gaps_beside_the_channels_of_planar_fresh_are_mended(tmp_path):
    job = planned(tmp_path, "planar_fresh")
    mark = job.marks.of(MarkKind.LAYER)[25]
    held = held_at(job, mark, "collagen_fresh", "fresh_150um")
    network = read_network_csv(tmp_path / "network.csv", "mm")
    voids = Voids.of_network(network, (92.0, 96.0, 1.0))
    paths = written_paths(held)
    top = max(path.points[0, 2] for path in paths)
    longest = sorted((p for p in paths if p.points[0, 2] == top), key=lambda p: p.length_mm)[-5:]
    gaps = [Gap(p.number, p.length_mm / 3, p.length_mm / 3 + 0.6) for p in longest]
    mend = plan_mend(held, gaps, voids)
    checked = check_mend(held, mend.lines, gaps, voids)
    assert not mend.left
    assert checked.passed
    assert checked.covered == 1.0


@pytest.mark.slow
def test_breaks_of_a_trees_newest_vessel_are_mended(tmp_path):
    job = planned(tmp_path, "planar_tree")
    mended = []
    for mark in job.marks.of(MarkKind.VESSEL)[::3]:
        held = held_at(job, mark, "gelatin_sacrificial", "30g_50mm")
        path = written_paths(held)[-1]
        low, high = np.array([0.4, 0.7]) * path.length_mm
        gap = Gap(path.number, float(low), float(high))
        mend = plan_mend(held, [gap])
        checked = check_mend(held, mend.lines, [gap])
        assert checked.passed
        mended.append(checked.covered)
    assert np.mean(mended) > 0.85
