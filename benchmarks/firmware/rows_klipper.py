"""Benchmark rows: prints on a real Klipper, judged from its motor steps."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.common import Row, row
from benchmarks.firmware.gcode_files import KLIPPER_HEAD, MotionFile, random_moves
from benchmarks.firmware.klipper_board import KlipperBoard
from benchmarks.firmware.klipper_config import STEPS_PER_MM
from benchmarks.firmware.product import print_file


def klipper_file(seed: int, moves: int) -> MotionFile:
    """Return random moves with Klipper's head and speeds."""
    made, file = random_moves(seed, moves), MotionFile(list(KLIPPER_HEAD))
    for to in made.targets[1:]:
        moved = {axis: to[axis] for axis in "XYZ" if to[axis] != file.targets[-1][axis]}
        file.move(240 if "Z" in moved else 1800, **moved, E=0.1 * to["E"])
    return file


def klipper_rows(home: Path, folder: Path, runs: int) -> Iterator[Row]:
    """Measure when the end is said, and whether the steps are the file's."""
    margins, wrong, others = [], 0, 0
    for seed in range(runs):
        file, place = klipper_file(seed, 15), folder / f"klipper-{seed}"
        place.mkdir(parents=True, exist_ok=True)
        job = file.write(place / "job.gcode")
        with KlipperBoard(home, place) as board:
            ended = print_file(job, board.port, "klipper_bioprinter")
            time.sleep(2.0)
            log, wanted = board.log(), file.end_steps(STEPS_PER_MM)
        found = log.positions()
        off = {a: (found[a], wanted[a]) for a in "XYZE" if abs(found[a] - wanted[a]) > 1}
        print(f"klipper {seed}: {ended} off {off}", file=sys.stderr, flush=True)
        if ended.state == "done":
            margins.append(ended.ended_s - log.last_edge_s())
            wrong += bool(off)
        else:
            others += 1
    name, least = f"real Klipper, {runs} prints: ", min(margins, default=float("nan"))
    yield row(name + "done, after the last step, least", round(least, 3), "s", "> 0", least > 0)
    yield row(name + "done, motors more than a step off", wrong, "prints", "0", wrong == 0)
    yield row(name + "ended otherwise than done", others, "prints", "0", others == 0)
