"""Draw two middle layers of a run's G-code, or all strokes of an embedded print, as SVG."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from printctl.checks.gcode_view import Pushing, read_job, read_line_map
from printctl.checks.gcode_view.outline import Design, PartOutlines
from report.gcode import GcodeJob, layer_figure
from report.gcode.colouring import Colouring, colourings

MOST_MOVES: Final = 40_000
"""In a picture of all passes; of more the report shows none."""

OUTLINED: Final = "the design's outline, orange where ink lies beyond it"


def layer_pictures(gcode: Path, pushing: Pushing, design: Design | None = None) -> dict[str, bytes]:
    """Draw the layer in the middle and the one after it (the infill turns from one to the next).

    With the design the first is drawn again under the design's outline, whose colour says how far
    ink lies beyond it, with seams. Of an embedded print all passes are drawn in one picture, from
    above. Every line is as wide as its own ink makes it, and coloured by that.

    Parameters
    ----------
    gcode : Path
        The job; its map from line to layer lies beside it.
    pushing : Pushing
        How E, or an open valve, becomes a volume.
    design : Solid and (3,) float64, mm, optional

    Returns
    -------
    dict of caption to SVG, for the report's toolpath section

    Raises
    ------
    UsageError
        When nothing in the file writes.
    """
    data = gcode.read_bytes()
    line_map, _ = read_line_map(gcode, data.count(b"\n"))
    job = read_job(data, gcode.name, pushing, line_map)
    count, colouring = len(job.layers), _by_width(job)
    if job.layers.passes:
        if len(job) > MOST_MOVES:
            return {}
        return {f"toolpath/{count} passes, from above": layer_figure(job, count - 1, colouring)}
    chosen = sorted({(count - 1) // 2, min(count // 2 + (count % 2), count - 1)})
    names = [
        f"toolpath/Layer {k + 1} of {count}, tip at z = {job.layers.z_mm[k]:.2f} mm" for k in chosen
    ]
    pictures = {
        name: layer_figure(job, k, colouring) for name, k in zip(names, chosen, strict=True)
    }
    if design is not None:
        outline = PartOutlines(job, *design).at(chosen[0])
        pictures[f"{names[0]}: {OUTLINED}"] = layer_figure(job, chosen[0], colouring, outline)
    return pictures


def _by_width(job: GcodeJob) -> Colouring:
    """By width where it is known; the first of the others else."""
    known = colourings(job)
    return next((each for each in known if each.key == "width"), known[0])
