"""Benchmark against real firmware, judged by motor step edges alone: ``make bench-firmware``.

Wants images that somebody else has built: ``--marlin`` an ELF file for the ATmega2560 (RAMPS 1.4,
E 500 steps/mm, emergency parser on, 115200 Bd), ``--marlin-without-parser`` the same without it,
``--marlin-fast`` one at 250000 Bd with ADVANCED_OK, ``--klipper`` a folder with ``klipper.elf``
(Linux process), ``klippy`` and ``python``. What isn't given is named in ``not_measured``.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.common import Row, commit, machine
from benchmarks.firmware.avr_board import BoardError, build_board
from benchmarks.firmware.rows_dead_line import dead_line_rows
from benchmarks.firmware.rows_done import done_rows
from benchmarks.firmware.rows_dry_run import random_rows, time_rows
from benchmarks.firmware.rows_faults import fault_rows
from benchmarks.firmware.rows_klipper import klipper_rows
from benchmarks.firmware.rows_looks import look_rows
from benchmarks.firmware.rows_noise import noise_rows
from benchmarks.firmware.rows_speed import speed_rows
from benchmarks.firmware.rows_stop import stop_rows

Job = Callable[[], Iterable[Row]]


def image(path: Path | None, what: str) -> Path:
    """Return the path; BoardError if it isn't given or isn't there."""
    if path is None:
        raise BoardError(f"no image was given ({what})")
    if not path.exists():
        raise BoardError(f"{path} doesn't exist ({what})")
    return path.resolve()


def marlin_job(
    measure: Callable[..., Iterable[Row]], path: Path | None, what: str, *more: Any
) -> Job:
    """Return a job on a Marlin image, which fails with a reason where it can't run."""

    def run() -> Iterable[Row]:
        found = image(path, what)
        build_board()
        return measure(found, *more)

    return run


def jobs(asked: argparse.Namespace, folder: Path) -> Iterator[tuple[str, Job]]:
    """Yield what to measure, with the name that stands in ``not_measured`` when it fails."""
    quick, first = asked.quick, asked.marlin
    runs, tries, files = (2, 2, 3) if quick else (12, 8, 20)
    if asked.repeats:
        runs = tries = files = asked.repeats
    yield "done", marlin_job(done_rows, first, "--marlin", folder / "done", runs)
    for rate in (0.0004, 0.003):
        place = folder / f"noise{rate:g}"
        name = f"noise {100 * rate:g} %"
        yield name, marlin_job(noise_rows, first, "--marlin", place, rate, runs)
    yield "faults", marlin_job(fault_rows, first, "--marlin", folder / "faults", tries)
    place = folder / "dead"
    yield "dead line", marlin_job(dead_line_rows, first, "--marlin", place, tries, "real Marlin")
    yield "looks", marlin_job(look_rows, first, "--marlin", folder / "looks", min(runs, 4))
    parser = "emergency parser on"
    yield "stop", marlin_job(stop_rows, first, "--marlin", folder / "stop", tries, parser)
    without, option = asked.marlin_without_parser, "--marlin-without-parser"
    parser = "emergency parser off"
    place = folder / "stop_without"
    yield "stop without parser", marlin_job(stop_rows, without, option, place, tries, parser)
    moves = 800 if quick else 3000
    for baud, path, option in (
        (115200, first, "--marlin"),
        (250000, asked.marlin_fast, "--marlin-fast"),
    ):
        more = (folder / str(baud), baud, moves, asked.repeats or 3, asked.board_speed)
        yield f"speed {baud}", marlin_job(speed_rows, path, option, *more)
    for baud, path, option in (
        (115200, first, "--marlin"),
        (250000, asked.marlin_fast, "--marlin-fast"),
    ):
        place, fast = folder / f"time{baud}", option == "--marlin-fast"
        more = (place, baud, fast, asked.part, asked.board_speed)
        yield f"dry run {baud}", marlin_job(time_rows, path, option, *more)
    yield "random files", marlin_job(random_rows, first, "--marlin", folder / "random", files)
    yield (
        "klipper",
        lambda: klipper_rows(image(asked.klipper, "--klipper"), folder / "klipper", runs),
    )
    yield (
        "klipper dead line",
        lambda: dead_line_rows(
            image(asked.klipper, "--klipper"), folder / "klipper-dead", tries, "real Klipper"
        ),
    )


def arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--marlin", type=Path, help="ELF file, emergency parser on, 115200 Bd")
    parser.add_argument("--marlin-without-parser", type=Path, help="ELF file, 115200 Bd")
    parser.add_argument("--marlin-fast", type=Path, help="ELF file, 250000 Bd")
    parser.add_argument("--klipper", type=Path, help="folder: klipper.elf, klippy/, python")
    parser.add_argument("--part", type=Path, help="G-code of a sliced part, for the dry run")
    parser.add_argument("--board-speed", type=float, default=1.0, help="for dry run and lines/s")
    parser.add_argument("--quick", action="store_true", help="fewer runs, tries and files")
    parser.add_argument("--repeats", type=int, help="prints, tries or files of each row")
    parser.add_argument("--only", help="only jobs whose name contains this")
    parser.add_argument("--keep", type=Path, help="folder for jobs, journals and step logs")
    return parser.parse_args()


def measure(asked: argparse.Namespace, folder: Path) -> Row:
    """Run the jobs; a job that can't run is named with its reason."""
    rows: list[Row] = []
    left_out = {}
    for name, job in jobs(asked, folder):
        if asked.only and asked.only not in name:
            left_out[name] = f"--only {asked.only}"
            continue
        begin = time.monotonic()
        try:
            rows += job()
        except (BoardError, OSError, ValueError, TimeoutError) as error:
            left_out[name] = f"{type(error).__name__}: {error}"
        print(f"{name}: {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)
    return {"rows": rows, "not_measured": left_out}


def main() -> None:
    """Measure and print the benchmark's one JSON object."""
    asked = arguments()
    load, measured = os.getloadavg()[0], commit()
    with tempfile.TemporaryDirectory() as temporary:
        found = measure(asked, asked.keep or Path(temporary))
    head = {"machine": machine() | {"load_before_and_after": [load, os.getloadavg()[0]]}}
    print(json.dumps(head | {"commit": measured} | found, indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
