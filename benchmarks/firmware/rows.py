"""Prints on a real Marlin on a simulated board, judged by motor step edges alone.

Wants images that somebody else has built, in the environment: MARLIN is an ELF file for the
ATmega2560 (RAMPS 1.4, E 500 steps/mm, emergency parser on, 115200 Bd), MARLIN_WITHOUT_PARSER the
same without it, MARLIN_FAST one at 250000 Bd with ADVANCED_OK.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.common import Row, SkippedError, scratch
from benchmarks.firmware.board import build_board
from benchmarks.firmware.rows_faults import fault_rows, noise_rows
from benchmarks.firmware.rows_looks import look_rows
from benchmarks.firmware.rows_stop import stop_rows
from benchmarks.firmware.rows_time import speed_rows, time_rows

BAUD = {"MARLIN": 115200, "MARLIN_FAST": 250000}


def on_boards(rows: Callable[[str, Path, Path], Iterator[Row]], *variables: str) -> Iterator[Row]:
    """Yield the rows of each image that the environment names; skip where it names none."""
    given = {name: Path(os.environ[name]).resolve() for name in variables if os.environ.get(name)}
    if not given:
        raise SkippedError(f"needs a Marlin image in {' or '.join(variables)}")
    build_board()
    for name, image in given.items():
        with scratch() as folder:
            yield from rows(name, image, folder)


def noise(quick: bool) -> Iterator[Row]:
    """Yield prints through noise, at two rates."""

    def measure(_: str, image: Path, folder: Path) -> Iterator[Row]:
        for rate in (0.0004, 0.003):
            yield from noise_rows(image, folder / f"{rate:g}", rate, 2 if quick else 12)

    return on_boards(measure, "MARLIN")


def faults(quick: bool) -> Iterator[Row]:
    """Yield prints with lost oks, pauses, kills, cable and reset."""
    tries = 2 if quick else 8
    return on_boards(lambda _, image, folder: fault_rows(image, folder, tries), "MARLIN")


def looks(quick: bool) -> Iterator[Row]:
    """Yield prints held for looks, mended and disturbed."""
    tries = 2 if quick else 4
    return on_boards(lambda _, image, folder: look_rows(image, folder, tries), "MARLIN")


def stop(quick: bool) -> Iterator[Row]:
    """Yield kills and stops, with and without an emergency parser."""

    def measure(name: str, image: Path, folder: Path) -> Iterator[Row]:
        parser = "emergency parser " + ("on" if name == "MARLIN" else "off")
        return stop_rows(image, folder, 2 if quick else 8, parser)

    return on_boards(measure, "MARLIN", "MARLIN_WITHOUT_PARSER")


def speed(quick: bool) -> Iterator[Row]:
    """Yield lines per second."""

    def measure(name: str, image: Path, folder: Path) -> Iterator[Row]:
        return speed_rows(image, folder, BAUD[name], 800 if quick else 3000, 1 if quick else 3)

    return on_boards(measure, *BAUD)


def dry_run(quick: bool) -> Iterator[Row]:
    """Yield the dry run's durations."""

    def measure(name: str, image: Path, folder: Path) -> Iterator[Row]:
        return time_rows(image, folder, BAUD[name], name == "MARLIN_FAST")

    return on_boards(measure, *BAUD)
