"""Job table, progress and remaining time, against slow oracles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware_profiles import Ink, Printer, Syringe, load
from printctl.checks.gcode_view import Pushing, read_job
from printctl.checks.preflight import HeadLoading, volumes
from printctl.machine.printing.job_table import JobTable
from printctl.machine.printing.journal_facts import read_so_far
from printctl.machine.printing.progress import Filling, progress
from printctl.machine.printing.remaining import Estimate, Remaining
from printctl.web.job.tabulating import make_table
from sim.gcode.dry_run.run import dry_run
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import layered

PRINTER, SYRINGE = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")
INK = load(Ink, "collagen_fresh")
START = (50.0, 50.0, 10.0)


def table_of(data: bytes) -> JobTable:
    run = dry_run(data, PRINTER, START)
    view = read_job(
        data, "job.gcode", Pushing(PRINTER, None, "", SYRINGE.inner_mm, SYRINGE.name), None
    )
    volume = volumes(run, PRINTER, [HeadLoading(SYRINGE, INK, None)])
    return make_table(parse_job(data, "job.gcode"), run, volume, view)


def naive(data: bytes) -> tuple[list[float], list[int]]:
    """µL and file line after each command, read line by line."""
    area = math.pi / 4 * SYRINGE.inner_mm**2 * INK.flow_factor
    ink, line = [0.0], [0]
    done = 0.0
    for number, text in enumerate(data.decode().splitlines(), start=1):
        if text.startswith(";"):
            continue
        words = {word[0]: float(word[1:]) for word in text.split()[1:] if word[1:]}
        if text.startswith("G1") and "E" in words:
            done = max(done, words["E"] * area)  # what was taken back comes out again
        ink.append(done)
        line.append(number)
    return ink, line


def test_the_table_tells_ink_line_and_layer_of_every_command():
    data = layered(4, 12)
    table = table_of(data)
    ink, line = naive(data)
    assert len(table) == len(line) - 1
    np.testing.assert_allclose(table.ink_ul, ink, atol=1e-9)
    assert table.file_line.tolist() == line
    assert table.layer_count == 4
    assert table.layers_done[-1] == 4
    assert (np.diff(table.time_s) >= 0).all()
    assert table.time_s[-1] == dry_run(data, PRINTER, START).duration_s
    lines = data.decode().splitlines()
    written = [k for k, text in enumerate(lines, 1) if text.startswith("G1 X") and "E" in text]
    for layer in range(4):
        moves = written[layer * 12 : (layer + 1) * 12]
        rows = np.flatnonzero(np.isin(table.file_line, moves))
        assert set(table.layer[rows].tolist()) == {layer}
        assert table.layers_done[rows[-1]] == layer + 1
        assert table.layers_done[rows[-2]] == layer


def test_ink_left_counts_from_the_syringe_that_was_put_in():
    table = table_of(layered(4, 12))
    area = math.pi / 4 * SYRINGE.inner_mm**2
    half = len(table) // 2
    filling = Filling(half, 5.0, area)
    told = progress(table, len(table), 0.0, 0.0, Estimate(0.0, None, 1.0), filling)
    used = (table.plunger_mm[-1] - table.plunger_mm[half]) * area
    assert told.ink_left_ul == pytest.approx(5.0 * area - used)
    assert progress(table, 3, 0.0, 0.0, Estimate(1.0, None, 1.0)).ink_left_ul is None


def test_the_error_told_covers_19_of_20_prints():
    rng, inside = np.random.default_rng(5), 0
    for _ in range(300):
        real = np.concatenate([[0.0], np.cumsum(10.0 * rng.normal(1.1, 0.2, 100))])
        remaining = Remaining(1000.0)
        for k in range(31):
            remaining.saw(10.0 * k, float(real[k]))
        told = remaining.estimate(300.0)
        assert told.error_s is not None
        inside += abs(real[100] - real[30] - told.remaining_s) <= told.error_s
    assert 0.90 <= inside / 300 <= 0.99


def test_pauses_are_left_out_of_the_time_at_work():
    state = {"t": "state"}
    records = [
        {"t": "job", "sha256": "a", "started": 100.0, "at": 100.0},
        {**state, "state": "printing", "at": 110.0},
        {**state, "state": "pausing", "at": 150.0},
        {**state, "state": "paused", "at": 155.0},
        {"t": "syringe", "done": 42, "plunger_mm": 1.5, "at": 300.0},
        {**state, "state": "resuming", "at": 400.0},
        {**state, "state": "printing", "at": 410.0},
    ]
    found = read_so_far(records)
    assert found.started == 100.0
    assert found.active_until(425.0) == pytest.approx(55.0)
    assert found.filled == (42, 1.5)
    ended = read_so_far([*records, {"t": "end", "state": "done", "at": 420.0}])
    assert ended.active_until(999.0) == pytest.approx(50.0)
    assert read_so_far([*records, {**records[0], "at": 500.0}]).active_s == pytest.approx(40.0)
