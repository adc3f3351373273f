"""Output files of `printctl overlay`: a picture per layer, a JSON of the results, and a page."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.files import write_bytes, write_text
from printctl.pipeline.overlaying import Overlay
from printctl.progress import Report
from registration.notes import wall_notes
from registration.overlay import LayerStatus, overlay_csv, overlay_dict
from registration.report.overlay import OverlayPage, PictureOf, draw_overlay, write_overlay_html
from registration.report.wording import number
from registration.wall_reference import WallCalibration

HTML, JSON, CSV = "overlay.html", "overlay.json", "overlay.csv"
_DIMMEST: Final = 0.15
"""Of the brightest layer's white; a layer of noise isn't stretched to full contrast."""


def write_overlay(
    folder: Path, overlay: Overlay, chosen: Sequence[int], data: dict[str, Any], report: Report
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


def _facts(overlay: Overlay, chosen: Sequence[int]) -> dict[str, Any]:
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


def summary_lines(data: dict[str, Any]) -> list[str]:
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


def _lines(gap: dict[str, Any]) -> str:
    if gap["line_count"] == 1:
        return f"line {gap['lines'][0]} of the G-code"
    return f"{gap['line_count']} lines of the G-code, {gap['first_line']} to {gap['last_line']}"


def _page(overlay: Overlay, layers: Sequence[dict[str, Any]], data: dict[str, Any]) -> OverlayPage:
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
