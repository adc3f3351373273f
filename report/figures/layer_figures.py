"""SVG figures of two middle layers of a run's G-code, or of all strokes of an embedded print."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from report.gcode import DesignOutline, GcodeJob, layer_figure
from report.gcode.colouring import colourings

MOST_MOVES: Final = 40_000
"""In a picture of all passes; of more the report shows none."""
OUTLINED: Final = "the design's outline, orange where ink lies beyond it"
OutlineAt = Callable[[int], DesignOutline]
"""The design's outline in a layer, counted from 0."""


def layer_figures(job: GcodeJob, outline_at: OutlineAt | None = None) -> dict[str, bytes]:
    """Draw the layer in the middle and the one after it (the infill turns from one to the next).

    With the design the first is drawn again under the design's outline, whose colour says how far
    ink lies beyond it, with seams. Of an embedded print all passes are drawn in one picture, from
    above. Every line is as wide as its own ink makes it, and coloured by that.

    Returns
    -------
    dict of name to SVG
    """
    count, known = len(job.layers), colourings(job)
    # By width where it is known; the first of the others else.
    colouring = next((each for each in known if each.key == "width"), known[0])
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
    if outline_at is not None:
        pictures[f"{names[0]}: {OUTLINED}"] = layer_figure(
            job, chosen[0], colouring, outline_at(chosen[0])
        )
    return pictures
