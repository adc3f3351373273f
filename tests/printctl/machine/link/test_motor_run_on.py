"""Run-on time of motors after a kill: predicted within 20 %, never too short."""

from __future__ import annotations

import math
import random
import re
from types import SimpleNamespace

import pytest

from firmware_profiles import Printer, load
from printctl.machine.link import modal
from printctl.machine.link.halting import halting_of
from printctl.machine.link.job import Job
from printctl.machine.link.modal import Modal
from printctl.machine.link.planned_moves import planned_moves
from printctl.machine.link.progress import JobProgress
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.gcode.reading import GcodeLine, read_sent

PRINTER = load(Printer, "marlin_avr").model_copy(update={"emergency_parser": False})
LOOK_S = 0.002


def random_moves(rng: random.Random) -> list[str]:
    """Moves of 5 to 60 mm at 10 to 120 mm/s: the fastest feed is far above the mean."""
    return [
        f"G1 X{rng.uniform(20, 90):.2f} Y{rng.uniform(20, 90):.2f} E{0.05 * k:.3f} "
        f"F{rng.uniform(600, 7200):.0f}"
        for k in range(60)
    ]


def raster(rng: random.Random) -> list[str]:
    feed = rng.uniform(900, 4500)
    return [
        f"G1 X{70 if k % 4 < 2 else 50} Y{50 + k // 2 * 0.3:.2f} F{feed:.0f}" for k in range(60)
    ]


def hops(rng: random.Random) -> list[str]:
    lines = []
    for k in range(15):
        x, y = rng.uniform(20, 80), rng.uniform(20, 90)
        travel, written = f"G0 X{x:.2f} Y{y:.2f} F9000", f"G1 X{x + 8:.2f} E{k * 0.1:.2f} F600"
        lines += ["G1 Z7 F300", travel, "G1 Z5 F300", written]
    return lines


def short_moves(rng: random.Random) -> list[str]:
    x, y, lines = 50.0, 50.0, []
    for k in range(60):
        x, y = x + rng.uniform(-3, 3), y + rng.uniform(-3, 3)
        lines.append(f"G1 X{x:.2f} Y{y:.2f} E{0.02 * k:.3f} F{rng.uniform(600, 3600):.0f}")
    return lines


def killed(lines: list[bytes], progress: JobProgress, taken: SimpleNamespace, rng, clock) -> float:
    """Feed a simulated board, kill it with a line waiting; return how long its motors ran on, s."""
    board = MarlinPrinter(PRINTER)
    board.advance(0.1)
    kill_after, strike, heard = rng.randint(25, 50), math.inf, board.exchange(lines[0] + b"\n")
    while board.now < strike:
        board.advance(LOOK_S)
        heard += board.exchange(b"")
        if b"ok" in heard:
            taken.lines_done += 1
            progress.answered(taken.lines_done, board.now)
            if taken.lines_done == kill_after:
                strike = board.now + rng.uniform(0, 0.3)
            heard = board.exchange(lines[taken.lines_done] + b"\n")
    assert b"halted" in board.exchange(b"M112\n")
    clock.append(board.now)
    board.advance(4.0)
    return float(board.executed().time_end[-1]) - clock[0]


@pytest.mark.parametrize("make", [random_moves, raster, hops, short_moves])
@pytest.mark.parametrize("seed", range(6))
def test_told_time_is_true_within_a_fifth_and_never_too_short(make, seed: int) -> None:
    rng = random.Random(f"{make.__name__} {seed}")
    head = ["G21", "G90", "M82", "M302 P1", "G92 X50 Y50 Z5 E0"]
    lines = [line.encode() for line in [*head, *make(rng)]]
    taken = SimpleNamespace(lines_done=0, line_errors=0)
    wiring = SimpleNamespace(printer=PRINTER, protocol=taken)
    progress = JobProgress(wiring, Job(lines, list(range(1, len(lines) + 1)), "", "a"))
    clock: list[float] = []
    true_s = killed(lines, progress, taken, rng, clock)
    halting = halting_of(PRINTER, b"M112\n", emergency_parser=False)
    found = re.search(r"up to ([\d.]+) s", halting.told(progress.run_on(clock[0]), stopped=False))
    assert found is not None
    assert true_s <= float(found[1]) <= 1.2 * true_s


def test_place_that_nobody_has_told_makes_a_move_long() -> None:
    """Too long is told, never too short."""
    (move,) = planned_moves([b"G1 X5 F600"], 0, 1, Modal(), PRINTER)
    assert move.length_mm >= 1000


def test_places_under_way_are_found_with_each_line_read_about_once(monkeypatch) -> None:
    """A job that never gives Z was once read from its end to its beginning for each place."""
    lines = [b"G1 X%d Y5 E%d F600" % (k % 7, k) for k in range(300)]
    wiring = SimpleNamespace(printer=PRINTER, protocol=SimpleNamespace(lines_done=300))
    progress = JobProgress(wiring, Job(lines, list(range(1, 301)), "", "a"))
    count = 0

    def counted(line: bytes) -> GcodeLine:
        nonlocal count
        count += 1
        return read_sent(line)

    monkeypatch.setattr(modal, "read_sent", counted)
    assert progress.places_under_way()[-1] == {"x": 5.0, "y": 5.0, "e": 299.0}
    assert count <= len(lines) + 100
    assert set(progress.heights()) == set()
    assert count <= 2 * len(lines) + 200
