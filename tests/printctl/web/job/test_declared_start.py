"""Declared start position of a large job, found quickly."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_profiles import Printer, load
from printctl.machine.link.errors import LinkError
from printctl.machine.link.job_start import declared_start
from printctl.web.job.declared_start import declared_of
from tests.printctl.machine.link.jobs import load_job

MOVES = b"".join(b"G1 X%d Y2 F600\n" % (k % 9) for k in range(5000))
PLACED = b"G21\nG92 X1 Y2 Z3 E0\n"


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (PLACED + MOVES, (1.0, 2.0, 3.0)),
        (PLACED + MOVES + b"G92 E0\n" + MOVES, (1.0, 2.0, 3.0)),
        (PLACED + MOVES + b"; G92 X9 Y9 Z9\n" + MOVES, (1.0, 2.0, 3.0)),
        (PLACED + MOVES + b"  G92 X9 Y9 Z9", (1.0, 2.0, 3.0)),
        (MOVES + PLACED + MOVES, None),
        (MOVES, None),
        (b"M105\n" * 3000 + PLACED + MOVES, (1.0, 2.0, 3.0)),
        (b"M105\n" * 3000 + MOVES + PLACED, None),
        (b"SET_KINEMATIC_POSITION X=1 Y=2 Z=3\n" + MOVES, (1.0, 2.0, 3.0)),
        (b"", None),
    ],
)
def test_the_start_is_that_of_the_whole_job(
    data: bytes, found: tuple[float, float, float] | None, tmp_path: Path
) -> None:
    path = tmp_path / "job.gcode"
    path.write_bytes(data)
    name = "klipper_bioprinter" if b"KINEMATIC" in data else "generic_marlin"
    assert declared_of(path, name) == found
    try:
        job = load_job(path, load(Printer, name))
        assert declared_start(job) == found
    except LinkError:
        assert found is None
