"""Write an ink prediction to a folder: CSV tables, playback page, time plots, optional voxels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from printctl.checks.bead.play import make_playback
from printctl.checks.bead.predict import InkPrediction
from printctl.checks.bead.tables import write_bead_csv, write_layers_csv, write_vessels_csv
from printctl.checks.bead.time_line import write_time_line
from printctl.checks.bead.vessels import VesselDiameters
from printctl.checks.bead.volumes import write_surface, write_voxels
from registration.report.play import save_played, write_play_html
from sim.gcode.bead import bead_deposit, swell

PLAY_PAGE: Final = "dry_run.html"
"""The page with the slider."""
PLAYED: Final = "predicted_play.npz"
"""The same for the report."""

VesselWidths = tuple[int, VesselDiameters, VesselDiameters | None]


@dataclass(frozen=True)
class OutputFiles:
    """Output files to write for a prediction.

    Attributes
    ----------
    voxel_mm : float or None, mm
        Of voxels and surface; neither without.
    window_s : (from, to) or None, s
        Of the time line; the whole without.
    title : str
        Of the page.
    keep_play : bool
        Whether the page's data are kept for a report.
    remarks : tuple of (int, str)
        Lines of the file, 0 for none, and what was found there otherwise; for the page.
    """

    voxel_mm: float | None = None
    window_s: tuple[float, float] | None = None
    title: str = "Dry run"
    keep_play: bool = False
    remarks: tuple[tuple[int, str], ...] = ()


def write_prediction(
    folder: Path,
    all_heads: Sequence[InkPrediction],
    vessels: Sequence[VesselWidths],
    facts: Sequence[Mapping[str, Any]],
    wanted: OutputFiles,
) -> list[str]:
    """Write tables, a page to play, a time line for each head, and voxels where they are wanted.

    Parameters
    ----------
    folder : Path
        Made where it isn't there.
    all_heads : sequence of InkPrediction
    vessels : sequence of (head, with lag, without lag)
        Empty where the network isn't known.
    facts : sequence of mapping
        `prediction_facts` of each head.
    wanted : OutputFiles

    Returns
    -------
    list of str
        Names of the files.

    Raises
    ------
    DepositError
        When the voxels would be too many.
    OSError
        When a file can't be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = ["predicted_bead.csv"]
    write_bead_csv(folder / names[0], list(all_heads))
    if vessels:
        names.append("predicted_vessels.csv")
        write_vessels_csv(folder / names[-1], list(vessels))
    if any(one.of_vessels is False for one in all_heads):
        names.append("predicted_layers.csv")
        write_layers_csv(folder / names[-1], list(all_heads))
    names += _write_play(folder, all_heads, vessels, facts, wanted)
    for one in all_heads:
        head = "" if len(all_heads) == 1 else f"_head{one.head}"
        names.append(f"time_line{head}.png")
        write_time_line(folder / names[-1], one, wanted.window_s)
        if wanted.voxel_mm is not None and np.any(one.bead.lays):
            laid = bead_deposit(one.bead, wanted.voxel_mm, swell(one.mounting.ink)[0])
            write_voxels(folder / f"predicted{head}.nrrd", laid)
            write_surface(folder / f"predicted{head}.ply", laid)
            names += [f"predicted{head}.nrrd", f"predicted{head}.ply"]
    return names


def _write_play(
    folder: Path,
    all_heads: Sequence[InkPrediction],
    vessels: Sequence[VesselWidths],
    facts: Sequence[Mapping[str, Any]],
    wanted: OutputFiles,
) -> list[str]:
    if not any(np.any(one.bead.lays & one.bead.writes) for one in all_heads):
        return []
    held = {head: late for head, late, _ in vessels}
    shown = make_playback(all_heads, facts, held, wanted.remarks)
    write_play_html(folder / PLAY_PAGE, shown, wanted.title)
    if not wanted.keep_play:
        return [PLAY_PAGE]
    save_played(folder / PLAYED, shown)
    return [PLAY_PAGE, PLAYED]
