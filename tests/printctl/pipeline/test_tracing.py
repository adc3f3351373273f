"""Trace from a place of the print to its G-code lines."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from design.geometry.surface import Surface
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray
from printctl.pipeline.tracing import Job, by_layer, made_by
from sim.gcode.deposit.strands import Strands

NO_FACES = np.empty((0, 3), dtype=np.int64)

NETWORK = VesselNetwork.from_segments(
    np.array([[0.0, 0, 0.5], [10, 0, 0.5]]),
    np.array([[0, 1]]),
    np.array([0.2]),
    np.zeros(1),
    np.zeros(1),
)


def written(start: FloatArray, end: FloatArray, line: IntArray) -> Strands:
    return Strands.dosed(start, end, np.ones(len(line)), np.arange(len(line)), line)


def job(of_vessels: bool = False) -> Job:
    """Ten layers of 0.1 mm; in each a line on either side of the vessel, at y = ±0.3."""
    start, end, line, source = [], [], [], []
    for layer in range(10):
        z = 0.1 * (layer + 1)
        for side in (-0.3, 0.3):
            start.append((0.0, side, z))
            end.append((10.0, side, z))
            line.append(10 * layer + (3 if side < 0 else 6))
            source.append(layer)
    first = 10 * np.arange(10) + 1
    return Job(
        written(np.array(start), np.array(end), np.array(line)),
        np.array(source), of_vessels, first, first + 9,
    )  # fmt: skip


def defect(kind: str = "stenosis", **more: object) -> dict[str, object]:
    return {"kind": kind, "vessel": 0, "from_mm": 4.0, "to_mm": 5.0, **more}


def test_lines_beside_a_stenosis_are_those_of_its_layers() -> None:
    found = made_by(defect(), job(), NETWORK, 0.1)
    # Within 0.2 + 0.15 mm of the axis at z = 0.5: the walls at 0.3 mm, 0.18 mm up and down.
    assert found["layers"] == [3, 4, 5]
    assert (found["first_line"], found["last_line"], found["line_count"]) == (33, 56, 6)


def test_a_vessels_own_line_is_named_in_an_embedded_print() -> None:
    one = Job(
        written(
            np.array([[0.0, 0, 0.5], [0, 5, 0.5]]), np.array([[10.0, 0, 0.5], [10, 5, 0.5]]),
            np.array([7, 9]),
        ), np.array([0, 1]), True, np.array([6, 8]), np.array([7, 9]),
    )  # fmt: skip
    found = made_by(defect("occlusion"), one, NETWORK, 0.0)
    assert found == {"vessels": [0], "first_line": 7, "last_line": 7, "line_count": 1}


def test_layers_of_different_heights_take_what_lies_in_them() -> None:
    """Two of 0.1 mm, the next without lines, then thinner ones; the first primes higher up."""
    tops = np.array([0.1, 0.1, 0.5, 0.2, 0.24, 0.26])
    end = np.column_stack([np.ones(6), np.zeros(6), tops])
    source = np.array([0, 0, 0, 1, 3, 4])
    lines = np.arange(1, 7)
    one = Job(written(end - [1, 0, 0], end, lines), source, False, np.arange(5), np.arange(5))
    report = SimpleNamespace(
        transform_scan_to_part=np.eye(4),
        scaled_scan_to_part=np.eye(4),
        surface=Surface(
            np.array([[0, 0, z] for z in (0.05, 0.15, 0.21, 0.23, 0.25, 0.4)]), NO_FACES
        ),
        seen=np.ones(6, dtype=bool),
        scaled_deviation_um=np.array([1.0, 2.0, 3.0, 4.0, 5.0, 7.0]),
    )
    rows = by_layer(report, one)  # type: ignore[arg-type]
    assert [row["mean_um"] for row in rows] == [1.0, 2.0, 3.0, 4.0, 6.0]
    assert [row["z_mm"] for row in rows] == pytest.approx([0.1, 0.2, 0.22, 0.24, 0.26])
