"""Cut a registered scan at each written layer of a run, and compare it with the G-code lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from printctl.errors import UsageError
from printctl.pipeline.written_layers import WrittenRun
from printctl.progress import Report
from registration import Scan
from registration.errors import RegistrationError
from registration.overlay import (
    Cutter,
    LayerLines,
    LayerNumbers,
    LayerStatus,
    Limits,
    LumenSections,
    Pose,
    Raster,
    ScanCut,
    measure_layer,
    reached,
    statuses,
)
from registration.segmentation import Segmentation

_GREY_PERCENT: Final = (1.0, 99.5)


@dataclass(frozen=True, eq=False)
class Overlay:
    """A scan held against every layer of a run.

    Attributes
    ----------
    run : WrittenRun
    scan : Scan
    pose : Pose
    cutter : Cutter
    lumens : LumenSections
    raster : Raster
    limits : Limits
    numbers : tuple of LayerNumbers
        Of all layers, the lowest first.
    status : tuple of LayerStatus
    grey : tuple of (float, float)
        Darkest and brightest of each layer's cut; NaN where it lies outside the scan.
    """

    run: WrittenRun
    scan: Scan
    pose: Pose
    cutter: Cutter
    lumens: LumenSections
    raster: Raster
    limits: Limits
    numbers: tuple[LayerNumbers, ...]
    status: tuple[LayerStatus, ...]
    grey: tuple[tuple[float, float], ...]


def overlay_scan(
    run: WrittenRun, scan: Scan, segmentation: Segmentation, pose: Pose, report: Report
) -> Overlay:
    """Measure every layer.

    Raises
    ------
    RegistrationError
        When no layer lies in the field of view.
    """
    raster = Raster.over(run.layers, run.line_mm)
    limits = Limits.of(run.line_mm, segmentation.field.blur_mm)
    cutter, lumens = Cutter(scan, segmentation, pose.matrix), LumenSections(run.lumen)
    numbers, grey = [], []
    for layer in run.layers:
        cut = cutter.cut(raster, layer.middle_mm)
        lumen = lumens.mask(raster, layer.middle_mm)
        numbers.append(measure_layer(layer, lumen, cut, raster, limits, run.corrected))
        grey.append(_greys(cut))
        report(layer.number / len(run.layers), f"layer {layer.number}")
    if all(one.in_view == 0 for one in numbers):
        raise RegistrationError(
            f"under this pose none of {run.name}'s {len(numbers)} layers lies in the scan's field "
            f"of view ({pose.said}) Give the pose of a scan that was taken in the same place"
        )
    overlay = Overlay(
        run,
        scan,
        pose,
        cutter,
        lumens,
        raster,
        limits,
        tuple(numbers),
        tuple(statuses(numbers)),
        tuple(grey),
    )
    return _with_the_last(overlay)


def _with_the_last(overlay: Overlay) -> Overlay:
    """The same; the topmost layer with gel is judged up to the line that it reached."""
    status, numbers = list(overlay.status), list(overlay.numbers)
    there = [k for k, one in enumerate(status) if one.judged]
    if there and LayerStatus.NOT_SEEN in status[there[-1] + 1 : there[-1] + 2]:
        return overlay  # what is written later wasn't looked at: a gap stays a gap
    moves = reached(numbers[there[-1]]) if there else None
    if moves is None:
        return overlay
    last = there[-1]
    layer = numbers[last].layer.upto(moves)
    cut = overlay.cutter.cut(overlay.raster, layer.middle_mm)
    lumen = overlay.lumens.mask(overlay.raster, layer.middle_mm)
    numbers[last] = measure_layer(
        layer, lumen, cut, overlay.raster, overlay.limits, overlay.run.corrected
    )
    status[last] = LayerStatus.UNDER_WAY
    return replace(overlay, numbers=tuple(numbers), status=tuple(status))


def _greys(cut: ScanCut) -> tuple[float, float]:
    there = cut.grey[cut.in_view]
    if there.size == 0:
        return np.nan, np.nan
    low, high = np.percentile(there, _GREY_PERCENT)
    return float(low), float(high)


def chosen_layers(layers: Sequence[LayerLines], wanted: Sequence[int]) -> list[int]:
    """Places of the layers that are wanted by number; all of them where none is.

    Raises
    ------
    UsageError
        For a number that no layer has.
    """
    count = len(layers)
    for one in wanted:
        if not 1 <= one <= count:
            raise UsageError(f"--layer {one}: the run has layers 1 to {count}")
    return sorted({one - 1 for one in wanted}) or list(range(count))
