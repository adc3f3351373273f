"""Build the live-view scene of a G-code file: each move as 16-bit coordinates, time and layer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.checks.gcode_view import LineMap, Reading, read_with_program
from printctl.web.live.source import JobSource
from report.gcode import Act

NONE: Final = 65_535
"""Vessel of a move that is of none."""
MOST: Final = 65_534
"""Largest number of a layer, width or vessel; more layers than that share numbers."""
_UM: Final = 1e-3
_SHOWN: Final = (Act.TRAVEL, Act.LIFTED, Act.WRITE, Act.WIPE, Act.JUMP)

X, Y, Z, LAYER, VESSEL, HEAD, WIDTH, ACT = range(8)
"""Columns of `LiveScene.points`."""


@dataclass(frozen=True, eq=False)
class LiveScene:
    """A line through all moves of a job; move i goes from point i to point i + 1.

    Attributes
    ----------
    points : (n + 1, 8) uint16
        Place in steps from ``low_mm``; layer, vessel (`NONE` for none), head, width in µm (0 where
        it isn't known) and `Act` of the move that ends there. A place that isn't joined to the one
        before is reached by a move of ``Act.JUMP``.
    command : (n,) uint32
        Which of the file's commands the move is of, from 0, as the link counts them
        (`printctl.machine.job.job.parse_job`); ascending. A move is executed when more commands
        than that are.
    time_s : (n,) float32, s
        At which the move ends, from the feeds alone.
    about : dict
        Numbers and names for the view, as `printctl.web.live.scene_worker` lists them.
    """

    points: NDArray[np.uint16]
    command: NDArray[np.uint32]
    time_s: NDArray[np.float32]
    about: dict[str, Any]


def make_scene(source: JobSource, gcode: bytes, line_map: LineMap | None) -> LiveScene:
    """Make the scene of a file, by the map beside it if there is one.

    Raises
    ------
    UsageError
        When it isn't G-code, or nothing in it writes.
    """
    # Strictly: moves are told by the count of commands that the link sends.
    reading = read_with_program(gcode, source.gcode.name, source.pushing(), line_map, strict=True)
    job, program = reading.job, reading.program
    sent = np.zeros(job.text.count(b"\n") + 2, np.int64)
    sent[program.line] = 1  # the link sends the lines that the reader found a command in
    number = np.cumsum(sent)
    kept = np.flatnonzero(_differ(job.start, job.end) & np.isin(job.act, _SHOWN))
    apart = np.ones(len(kept), bool)
    apart[1:] = _differ(job.start[kept[1:]], job.end[kept[:-1]])
    apart[:1] = False
    jumps = np.flatnonzero(apart)
    move = np.insert(kept, jumps, kept[jumps])
    jumped = np.insert(np.zeros(len(kept), bool), jumps, True)
    end = np.where(jumped[:, None], job.start[move], job.end[move])
    place = np.vstack([job.start[kept[:1]], end])
    low, high = _box(place)
    step = np.maximum((high - low) / 65_535, 1e-6)  # so that all places fit into 16 bits
    group = max(1, -(-len(job.layers) // MOST))
    points = np.zeros((len(place), 8), np.uint16)
    points[:, :3] = np.rint((place - low) / step)
    points[1:, LAYER] = job.layer[move] // group
    points[1:, VESSEL] = _vessels(job.vessel, move)
    points[1:, HEAD] = program.tool[reading.row[move]]
    width_um = np.where(jumped, 0, np.nan_to_num(job.width_mm[move]) / _UM)
    points[1:, WIDTH] = np.clip(np.rint(width_um), 0, MOST)
    points[1:, ACT] = np.where(jumped, np.uint8(Act.JUMP), job.act[move])
    time = np.cumsum(job.time_s)
    about = _about(reading, place, points, group)
    about |= {"commands": int(number[-1]), "low_mm": low.tolist(), "step_mm": step.tolist()}
    about |= {"outlines": [[list(at) for at in line] for line in source.outlines]}
    return LiveScene(
        points,
        (number[job.line[move]] - 1).astype(np.uint32),
        np.where(jumped, time[move] - job.time_s[move], time[move]).astype(np.float32),
        about,
    )


def _differ(one: FloatArray, other: FloatArray) -> BoolArray:
    """Whether places, (n, 3) each, differ; column by column, five times as fast as by rows."""
    apart = one[:, 0] != other[:, 0]
    apart |= one[:, 1] != other[:, 1]
    apart |= one[:, 2] != other[:, 2]
    return np.asarray(apart)


def _box(place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest corner, mm; column by column for the same reason as `_differ`."""
    return np.array([one.min() for one in place.T]), np.array([one.max() for one in place.T])


def _vessels(vessel: IntArray | None, move: IntArray) -> NDArray[np.uint16]:
    if vessel is None:
        return np.full(len(move), NONE, np.uint16)
    number = vessel[move]
    return np.where(number < 0, NONE, number % MOST).astype(np.uint16)


def _about(
    reading: Reading, place: FloatArray, points: NDArray[np.uint16], group: int
) -> dict[str, Any]:
    """Numbers and names that the view shows."""
    job = reading.job
    vessels = points[1:, VESSEL]
    writes = points[1:, ACT] == Act.WRITE
    ends = np.zeros(len(place), bool)
    ends[1:] = writes
    ends[:-1] |= writes
    low, high = _box(place[ends])
    return {
        "name": job.name,
        "passes": job.layers.passes,
        "layer_group": group,
        "layers": np.round(job.layers.z_mm[group - 1 :: group], 4).tolist(),
        "vessels": len(np.unique(vessels[vessels != NONE])),
        "heads": int(points[1:, HEAD].max(initial=0)) + 1,
        "written_low_mm": low.tolist(),
        "written_high_mm": high.tolist(),
        "duration_s": float(job.time_s.sum()),
        "notes": list(job.notes),
    }
