"""Progress table of a job, against a slow oracle."""

from __future__ import annotations

import math

import numpy as np

from firmware_profiles import Ink, Printer, Syringe, load
from gcode.dry_run.run import dry_run
from printctl.checks.gcode_view import Pushing, read_job
from printctl.checks.preflight import HeadLoading, volumes
from printctl.machine.prints.progress import JobTable
from printctl.pipeline.job.job_table import make_table
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
