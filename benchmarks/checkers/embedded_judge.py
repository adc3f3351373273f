"""Judge an embedded print by its G-code alone. Shares no code with the product."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.embedded_axes import Axes, read_axes
from benchmarks.checkers.embedded_ink import BIN_MM, Ink, overlap_ul, written_ink
from benchmarks.checkers.embedded_joints import cuts_of, joints_of, open_joints, pass_ends
from benchmarks.checkers.embedded_moves import Moves, read_embedded
from benchmarks.checkers.embedded_overlaps import overlaps_near
from benchmarks.checkers.embedded_shaft import Bad, bad_moves

FloatArray = NDArray[np.float64]
SYRINGE_MM = 4.61
"""Bore of the product's default syringe, which says what E pushes."""


def judge(
    gcode_path: Path | str,
    network_csv_path: Path | str,
    needle_outer_mm: float,
    *,
    place_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    syringe_bore_mm: float = SYRINGE_MM,
    flow_factor: float = 1.0,
    scale: float = 1.0,
    graze_mm: float = 0.005,
    named: int = 20,
) -> dict[str, Any]:
    """Read G-code and network (mm), and say what is wrong with the print.

    Parameters
    ----------
    gcode_path, network_csv_path : path
    needle_outer_mm : float
        Outer diameter; no clearance is added.
    place_mm : (3,) float, mm
        Where the network's origin lies in the G-code's frame.
    syringe_bore_mm, flow_factor : float
        Volume pushed per mm of E: pi / 4 bore² × factor.
    scale : float
        Of the print against the network.
    graze_mm : float
        Depth up to which touching ink isn't counted.
    named : int
        How many bad moves and open joints are named.

    Returns
    -------
    dict
        ``bad_moves``, ``bad_moves_elsewhere`` than where the network overlaps itself,
        ``bad_passes``, ``joints``, ``joints_open``, ``cuts``, ``cuts_open``, ``passes``, speeds,
        volumes, times; ``bad`` and ``open`` name them (line, vessels, place
        in the network's frame).
    """
    axes = read_axes(Path(network_csv_path), scale)
    moves = _moved(read_embedded(Path(gcode_path).read_text()), np.array(place_mm))
    ul_per_e = np.pi / 4 * syringe_bore_mm**2 * flow_factor
    ink = written_ink(moves, axes, ul_per_e)
    if not len(ink.point):
        raise ValueError(f"{gcode_path}: no move writes ink")
    cuts = cuts_of(axes, ink)
    bad = bad_moves(moves, ink, axes, pass_ends(axes, ink), needle_outer_mm, graze_mm)
    unclosed, joints = open_joints(joints_of(axes), axes, moves, ink)
    uncut, cut = open_joints(cuts, axes, moves, ink)
    return {
        **_crossings(bad, moves, ink, axes, needle_outer_mm, named),
        "joints": joints,
        "joints_open": len(unclosed),
        "cuts": cut,
        "cuts_open": len(uncut),
        "open": (unclosed + uncut)[:named],
        **_written(moves, written_ink(moves, axes, ul_per_e, 0.5 * BIN_MM), axes),
        **_times(moves),
    }


def _moved(moves: Moves, place: FloatArray) -> Moves:
    return Moves(
        moves.line, moves.start - place, moves.end - place, moves.pushed, moves.speed, moves.dwell_s
    )


def _crossings(
    bad: Bad, moves: Moves, ink: Ink, axes: Axes, needle_outer_mm: float, named: int
) -> dict[str, Any]:
    first = np.searchsorted(ink.move, bad.move)
    writes = moves.writes[bad.move]
    # A travel belongs to the pass that it leads to, a lift to the one that it follows.
    rises = ~writes & (moves.end[bad.move, 2] > moves.start[bad.move, 2])
    at = np.clip(first - rises, 0, len(ink.stroke) - 1)
    share = np.linspace(0.0, 1.0, 33)[:, None, None]
    start, end = moves.start[bad.move], moves.end[bad.move]
    ways = (start + share * (end - start)).transpose(1, 0, 2)
    own = [
        overlaps_near(axes, int(vessel), int(through), way, needle_outer_mm)
        for vessel, through, way in zip(ink.vessel[at], bad.through, ways, strict=True)
    ]
    deepest = np.lexsort((-bad.depth_mm, own))[:named]
    return {
        "bad_moves": len(bad.move),
        "bad_moves_elsewhere": len(own) - sum(own),
        "bad_writing": int(writes.sum()),
        "bad_travels": int((~writes).sum()),
        "bad_passes": len(np.unique(ink.stroke[at])),
        "bad": [
            {
                "line": int(moves.line[bad.move[k]]),
                "kind": "writing" if writes[k] else "travel",
                "vessel": int(ink.vessel[at[k]]),
                "through": int(bad.through[k]),
                "depth_mm": round(float(bad.depth_mm[k]), 4),
                "at_own_overlap": own[k],
                "at_mm": np.round(moves.end[bad.move[k]], 3).tolist(),
            }
            for k in sorted(deepest)
        ],
    }


def _written(moves: Moves, ink: Ink, axes: Axes) -> dict[str, Any]:
    volume = ink.volume_ul
    beside = float(volume[ink.vessel < 0].sum())
    written = float(volume.sum()) - beside
    overlap = overlap_ul(ink, axes)
    speed = moves.speed[moves.writes]
    single = (ink.vessel >= 0) & (ink.off_mm < 0.03)
    ratio = ink.radius[single] / ink.design_radius[single]
    return {
        "passes": int(ink.stroke.max()) + 1,
        "speed_least_mm_s": round(float(speed.min()), 4),
        "speed_most_mm_s": round(float(speed.max()), 4),
        "design_ul": axes.volume_ul,
        "written_ul": written,
        "beside_ul": beside,
        "overlap_ul": overlap,
        "volume_error_percent": 100 * ((written - overlap) / axes.volume_ul - 1),
        "radius_error_p1_p99_percent": [
            round(float(100 * (q - 1)), 2) for q in np.percentile(ratio, [1, 99])
        ],
        "written_mm": float(ink.length.sum()),
        "design_mm": float(axes.length.sum()),
    }


def _times(moves: Moves) -> dict[str, float]:
    """Seconds at constant speeds; an upright travel is a lift."""
    duration = np.where(np.isnan(moves.speed), 0.0, moves.duration)
    upright = np.linalg.norm((moves.end - moves.start)[:, :2], axis=1) < 1e-9
    travels = ~moves.writes & ~moves.stands
    found = {
        "writing_s": float(duration[moves.writes].sum()),
        "travel_s": float(duration[travels & ~upright].sum()),
        "lift_s": float(duration[travels & upright].sum()),
        "plunger_s": float(duration[moves.stands].sum()),
        "dwell_s": moves.dwell_s,
    }
    return found | {"total_s": sum(found.values())}
