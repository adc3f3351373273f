"""Compare a registered scan with a run's G-code by layer; write the pictures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.files import write_bytes, write_text
from printctl.errors import UsageError
from printctl.pipeline.prepared.written_layers import WrittenRun
from printctl.progress import Report
from registration import Scan
from registration.errors import RegistrationError
from registration.json_ready import Record
from registration.notes import wall_notes
from registration.overlay import (
    Cutter,
    LayerLines,
    LayerNumbers,
    LayerStatus,
    Limits,
    LumenSections,
    OverlayLayer,
    OverlaySpot,
    Pose,
    Raster,
    ScanCut,
    measure_layer,
    overlay_csv,
    overlay_dict,
    reached,
    statuses,
)
from registration.segmentation import Segmentation
from registration.wall_reference import WallCalibration
from report.overlay import OverlayPage, PictureOf, draw_overlay, write_overlay_html
from report.wording import number

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


HTML, JSON, CSV = "overlay.html", "overlay.json", "overlay.csv"
_DIMMEST: Final = 0.15
"""Of the brightest layer's white; a layer of noise isn't stretched to full contrast."""


def write_overlay(
    folder: Path, overlay: Overlay, chosen: Sequence[int], data: Record, report: Report
) -> dict[str, Any]:
    """Draw the chosen layers and write pictures, numbers and page; return overlay.json's content.

    Parameters
    ----------
    folder : Path
    overlay : Overlay
    chosen : sequence of int
        Places of the layers, the lowest first.
    data : dict
        What overlay.json says besides.
    report : Report
    """
    folder.mkdir(parents=True, exist_ok=True)
    pictures: dict[int, bytes] = {}
    for done, k in enumerate(chosen):
        layer = overlay.numbers[k].layer.number
        pictures[layer] = draw_overlay(_picture(overlay, k))
        write_bytes(folder / picture_name(layer), pictures[layer])
        report((done + 1) / len(chosen), f"layer {layer}")
    layers = [overlay_dict(overlay.numbers[k], overlay.status[k]) for k in chosen]
    data = {**data, **_facts(overlay, chosen), "layers": layers}
    write_text(folder / JSON, json.dumps(data, indent=1, allow_nan=False) + "\n")
    write_text(folder / CSV, overlay_csv(layers))
    write_overlay_html(folder / HTML, _page(overlay, layers, data), layers, pictures)
    return data


def picture_name(layer: int) -> str:
    """Of one layer's picture."""
    return f"layer_{layer:04d}.png"


def _picture(overlay: Overlay, k: int) -> PictureOf:
    height = overlay.numbers[k].layer.middle_mm
    return PictureOf(
        numbers=overlay.numbers[k],
        status=overlay.status[k],
        cut=overlay.cutter.cut(overlay.raster, height),
        lumen=overlay.lumens.mask(overlay.raster, height),
        raster=overlay.raster,
        grey=_shown(overlay, k),
        scale="dB" if overlay.scan.scale == "db" else "linear",
        count=len(overlay.numbers),
    )


def _shown(overlay: Overlay, k: int) -> tuple[float, float]:
    """What is drawn black and white: one black for all layers, each layer's own white."""
    every = np.array(overlay.grey)
    black = float(np.nanmin(every[:, 0]))
    brightest = float(np.nanmax(every[:, 1]))
    own = float(np.nan_to_num(every[k, 1], nan=brightest))
    return black, max(own, black + _DIMMEST * (brightest - black), black + 1e-9)


def _facts(overlay: Overlay, chosen: Sequence[int]) -> dict[str, object]:
    """What holds for all layers, and how many of the chosen ones were what."""
    status = [overlay.status[k] for k in chosen]
    return {
        "pose": {
            "said": overlay.pose.said,
            "this_scan_aligned": overlay.pose.aligned,
            "scan_to_part": overlay.pose.matrix.tolist(),
            "notes": list(overlay.pose.notes),
        },
        "pixel_um": 1e3 * overlay.raster.pixel_mm,
        "edge_um": 1e3 * overlay.limits.edge_mm,
        "least_mm2": overlay.limits.least_mm2,
        "least_width_um": 1e3 * overlay.limits.least_width_mm,
        "layer_count": len(overlay.numbers),
        "under_way": _under_way(overlay, chosen),
        "status_counts": {str(one): status.count(one) for one in LayerStatus},
        "notes": [*overlay.run.notes, *overlay.scan.notes],
    }


def _under_way(overlay: Overlay, chosen: Sequence[int]) -> dict[str, int] | None:
    """Layer and last written line of the chosen layer that was being written."""
    for one, status in ((overlay.numbers[k], overlay.status[k]) for k in chosen):
        if status == LayerStatus.UNDER_WAY:
            return {"layer": one.layer.number, "line": int(one.layer.line[-1])}
    return None


def summary_lines(data: Record) -> list[str]:
    """What was found, in sentences; the first is the shortest."""
    judged = [one for one in data["layers"] if one["gap_count"] is not None]
    bad = [one for one in judged if one["gap_count"] or one["blob_count"]]
    counts = data["status_counts"]
    parts = [f"{count} {name}" for name, count in counts.items() if count]
    head = "No gap and no blob" if not bad else f"{len(bad)} layer{_s(len(bad))} to look at"
    if not judged:
        head = "Nothing of these layers to judge"
    count, total = len(data["layers"]), data["layer_count"]
    these = f"{count} of {total}" if count < total else f"{total}"
    lines = [head, f"Of {these} layers: {', '.join(parts)}."]
    if data["under_way"] is not None:
        last = data["under_way"]
        lines.append(f"Layer {last['layer']} is written up to line {last['line']} of the G-code.")
    for name, text in (("gaps", "gap"), ("blobs", "blob of gel in a lumen")):
        worst = max(
            (one for one in judged if one[name]),
            key=lambda one: float(one[name][0]["area_mm2"]),
            default=None,
        )
        if worst is not None:
            x, y, z = worst[name][0]["at_mm"]
            lines.append(
                f"Largest {text}: layer {worst['layer']}, "
                f"{number(worst[name][0]['area_mm2'], 2)} mm² at x {x:.2f}, y {y:.2f}, z {z:.2f} mm"
                + (f", {_lines(worst[name][0])}." if name == "gaps" else ".")
            )
    return lines


def _s(count: int) -> str:
    return "" if count == 1 else "s"


def _lines(gap: OverlaySpot) -> str:
    if gap["line_count"] == 1:
        return f"line {gap['lines'][0]} of the G-code"
    return f"{gap['line_count']} lines of the G-code, {gap['first_line']} to {gap['last_line']}"


def _page(overlay: Overlay, layers: Sequence[OverlayLayer], data: Record) -> OverlayPage:
    lines = summary_lines(data)
    judged = any(one["gap_count"] is not None for one in layers)
    wrong = any(one["gap_count"] or one["blob_count"] for one in layers)
    edge, least, thin = (number(data[k], 2) for k in ("edge_um", "least_mm2", "least_width_um"))
    return OverlayPage(
        title=f"{overlay.run.name}: scan over G-code",
        facts=(f"Scan: {data['scan']}", f"Run: {data['model']}", f"{len(layers)} layers shown"),
        verdict=tuple(lines),
        good=not wrong if judged else None,
        notes=(
            overlay.pose.said,
            *overlay.pose.notes,
            "Gel or not is decided by the segmentation that printctl register uses; grey values "
            "are the scan's own, cut level at the middle of each layer.",
            f"Gaps and blobs lie farther than {edge} µm (twice the blur) from the border of "
            f"written and free, and are at least {least} mm² large and {thin} µm wide; shares "
            "count every seen pixel.",
            "The topmost layer with gel is judged up to the line where its gel ends, if all that "
            "is written later has none; if the printer was further, it gave no ink from there on.",
            "A layer that is out of view or unlit is called not seen, and one without gel under "
            "nothing but more such layers not printed: neither counts as failed.",
            *wall_notes(data["walls"] and WallCalibration(**data["walls"]), ()),
            *data["notes"],
        ),
    )
