"""Benchmark rows: prints on a real Marlin through a noisy line that loses oks."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.common import Row, row
from benchmarks.firmware.avr_board import AvrBoard
from benchmarks.firmware.gcode_files import random_moves
from benchmarks.firmware.product import print_file
from benchmarks.firmware.rows_done import Judged, judge

LOST_OKS = 0.01


def one_noisy(image: Path, folder: Path, seed: int, rate: float) -> Judged:
    """Print a file of random moves through noise."""
    folder.mkdir(parents=True, exist_ok=True)
    file = random_moves(1000 + seed, 40)
    job = file.write(folder / f"noise-{rate:g}-{seed}.gcode")
    with AvrBoard(image, folder / f"noisy-{rate:g}-{seed}") as board:
        board.tell(f"noise both {rate} {seed + 1}")
        board.tell(f"lostok {LOST_OKS}")
        ended = print_file(job, board.port, within_s=300)
        judged = judge(file, ended, board)
        state = board.state()
    figures = {key: state[key] for key in ("corrupted", "lost_oks", "resets")}
    print(f"noise {rate:g}, seed {seed}: {judged} {figures}", file=sys.stderr, flush=True)
    return judged


def noise_rows(image: Path, folder: Path, rate: float, runs: int) -> Iterator[Row]:
    """Measure how prints end, and whether those called done have the file's steps."""
    found = [one_noisy(image, folder, seed, rate) for seed in range(runs)]
    done = [one for one in found if one.ended.state == "done"]
    name = f"real Marlin, {runs} prints, {100 * rate:g} % of bytes garbled, 1 % of oks lost: "
    wrong = sum(bool(one.wrong_axes) for one in done)
    yield row(name + "done, but the motors stand elsewhere", wrong, "prints", "0", wrong == 0)
    smooth = [one for one in done if one.ended.pauses == 0]
    doubled = sum(one.surplus != 0 for one in smooth)
    yield row(
        name + "done without a pause, but with other steps", doubled, "prints", "0", not doubled
    )
    early = sum(one.margin_s <= 0 for one in done)
    yield row(name + "done before the last step", early, "prints", "0", early == 0)
    others = len(found) - len(done)
    goal = ("0", others == 0) if rate < 0.001 else ("", None)
    yield row(name + "not done", others, "prints", *goal)
