"""Faults of the ink, against lines whose ink is known by arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

from sim.devices.faults import load_faults
from sim.errors import ServeError
from sim.gcode.deposit.ink_faults import InkFaults, Timeline
from sim.gcode.deposit.lay import deposit, laid
from sim.gcode.motion.executed import ExecutedMotion

AREA, WIDTH, HEIGHT, LENGTH = 10.0, 0.2, 0.1, 5.0
DOSE = WIDTH * HEIGHT * LENGTH


def rows(layers: int = 2, lines: int = 4, purge_after: int = -1) -> ExecutedMotion:
    """Lines of 5 mm, 0.2 mm apart, a second a block; 1 µL pushed in a stand after one of them."""
    points, volumes = [(0.0, 0.0, HEIGHT)], []
    for number in range(layers * lines):
        z = HEIGHT * (1 + number // lines)
        y = 1 + 0.3 * (number % lines)
        points += [(0.0, y, z), (LENGTH, y, z)]
        volumes += [0.0, DOSE]
        if number == purge_after:
            points += [points[-1]]
            volumes += [1.0]
    where = np.array(points)
    plunger = np.concatenate([[0.0], np.cumsum(volumes)]) / AREA
    time = np.arange(len(where), dtype=float)
    return ExecutedMotion(
        where[:-1], where[1:], plunger[:-1], plunger[1:], time[:-1], time[1:],
        np.arange(len(volumes)),
    )  # fmt: skip


def faults(tmp_path, text: str, seed: int = 3) -> InkFaults:
    path = tmp_path / "faults.yaml"
    path.write_text(f"seed: {seed}\nink:\n  - {text}\n")
    return load_faults(path).of_ink


def ink_of(tmp_path, text: str, motion: ExecutedMotion | None = None):
    return laid(motion or rows(), faults(tmp_path, text), AREA, plunger_step_mm=1e-6)


def test_clog_ends_the_ink_where_it_begins_and_lets_it_come_again(tmp_path):
    found = ink_of(tmp_path, "{fault: clog, written_mm: 7, lasts_mm: 1.5}")
    assert found.written_ul == pytest.approx(8 * DOSE * (1 - 1.5 / 40))
    second = found.strands.line == 3
    assert found.strands.end[second][0, 0] == pytest.approx(2.0)
    assert found.strands.start[second][1, 0] == pytest.approx(3.5)
    assert len(np.unique(found.strands.stroke)) == 9


def test_purge_clears_a_clog(tmp_path):
    text = "{fault: clog, written_mm: 7, clears_ul: 0.4, passes: 0.25}"
    mended = ink_of(tmp_path, text, rows(purge_after=2))
    assert mended.written_ul == pytest.approx(DOSE * (8 - 0.75 * (15 - 7) / LENGTH))
    never = ink_of(tmp_path, text.replace("0.4", "1.4"), rows(purge_after=2))
    assert never.written_ul == pytest.approx(DOSE * (7 / 5 + 0.25 * 33 / 5))


def test_drift_is_a_step_or_a_ramp(tmp_path):
    step = ink_of(tmp_path, "{fault: drift, line: 4, factor: 1.3}")
    assert step.written_ul == pytest.approx(DOSE * (1 + 7 * 1.3))
    ramp = ink_of(tmp_path, "{fault: drift, written_mm: 10, factor: 0.7, over_mm: 20}")
    assert ramp.written_ul == pytest.approx(DOSE * (2 + 4 * 0.85 + 2 * 0.7))


def test_bubble_is_missing_and_catches_up(tmp_path):
    text = "{fault: bubble, pushed_ul: 0.15, ul: 0.05, catches_up: 0.6}"
    found = ink_of(tmp_path, text)
    assert found.written_ul == pytest.approx(8 * DOSE - 0.05 + 0.03)
    assert found.strands.area_mm2.max() == pytest.approx(1.6 * WIDTH * HEIGHT)


def test_empty_syringe_lays_nothing_more(tmp_path):
    found = ink_of(tmp_path, "{fault: empty, pushed_ul: 0.25, fades_ul: 0.1}")
    assert found.written_ul == pytest.approx(0.25 + 0.05)


def test_skipped_steps_shift_what_follows(tmp_path):
    found = ink_of(tmp_path, "{fault: skip, written_mm: 12, shift_mm: [0.3, -0.1]}")
    y = found.strands.start[found.strands.line == 5, 1]
    np.testing.assert_allclose(y, [1.6, 1.5])
    assert found.strands.end[-1] == pytest.approx([5.3, 1.8, 0.2])


def test_sag_widens_layers_and_sinks_filaments(tmp_path):
    text = "{fault: sag, written_mm: 20, percent: 25, drop_mm: 0.05}"
    found = ink_of(tmp_path, text)
    assert found.strands.area_mm2[-1] == pytest.approx(1.25 * WIDTH * HEIGHT)
    sunk = laid(rows(), faults(tmp_path, text), AREA, style="embedded", plunger_step_mm=1e-6)
    assert sunk.strands.end[-1, 2] == pytest.approx(0.15)


def test_debris_lies_beside_the_line_in_the_scan_too(tmp_path):
    wrong = faults(
        tmp_path, "{fault: debris, written_mm: 2.5, diameter_mm: 0.8, offset_mm: [0, -0.6]}"
    )
    voxels = deposit(rows(), AREA, 0.05, faults=wrong, plunger_step_mm=1e-6)
    x, y, z = np.round((np.array([2.5, 0.4, 0.05]) - voxels.origin_mm) / 0.05).astype(int)
    assert voxels.volume[z, y, x] == 255
    assert voxels.written_ul == pytest.approx(8 * DOSE + np.pi / 4 * 0.64 * HEIGHT)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{fault: clog}", "give one of line, time_s, written_mm and pushed_ul"),
        ("{fault: clog, line: 2, passes: 1}", "passes"),
        ("{fault: melt, line: 2}", "ink.0"),
        ("{fault: skip, line: 2, shift_mm: [0.1, 0], factor: 2}", "factor"),
    ],
)
def test_what_means_nothing_is_refused(tmp_path, text, message):
    with pytest.raises(ServeError, match=message):
        faults(tmp_path, text)


def test_ink_of_a_second_syringe_counts_on():
    push = np.array([40.0, -1.0, 1.0, 10.0, -20.0, -30.0, 2.0, 5.0, -1.0, 1.5])
    line = Timeline.of(
        np.column_stack([np.arange(10.0), np.arange(1.0, 11)]),
        np.arange(10),
        np.ones(10),
        push,
        push > 0,
    )
    np.testing.assert_allclose(line.pushed_ul, [0, 40, 40, 40, 50, 50, 50, 52, 57, 57, 57.5])
