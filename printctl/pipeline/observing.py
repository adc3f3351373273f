"""Write the order file for observing a run's print, from the recipe section `observe`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import yaml

from design.files import write_text
from design.network_files.csv_format import write_network_csv
from kernels.arrays import FloatArray
from printctl.machine.job.care import Care
from printctl.machine.job.job import load_job
from printctl.machine.job.look_places import Written, look_places
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.syringes import usable_mm
from printctl.machine.process.simulated import EXECUTED
from printctl.observe.deciding import Costs, FlowLimits, GapTest, Limits
from printctl.observe.devices import PICTURE_TIME_SHARE, DeviceSettings
from printctl.observe.order import ObserverOrder
from printctl.observe.records import ORDER_FILE
from printctl.pipeline.context import RunContext
from printctl.recipe.sections.observe import ObservePart, look_interval
from printctl.recipe.sections.toolpath import Embedded
from printctl.run_folder.artefacts import GCODE
from registration.devices.camera_frame.frame import read_frame

NETWORK_FILE: Final = "observed_network.csv"
DEVICE_FILE: Final = "simulated_device.yaml"
_MARGIN_MM: Final = 2.0
_PICTURE_PX: Final = 2000
_ABOVE_MM: Final = 0.3
_OCT_ACROSS: Final = 500
_LASER_ACROSS: Final = 2000
_OCT_SIDE_UM, _OCT_DEEP_UM = 20.0, 12.0
_CARE: Final = {
    "height": "look_every_height_mm",
    "time": "look_every_s",
    "written_way": "look_every_mm",
    "written_time": "look_every_written_s",
}


def look_care(part: ObservePart | None, *, embedded: bool) -> dict[str, Any]:
    """When the print is held for a look, for `printctl.machine.job.care.Care`."""
    if part is None:
        return {}
    care: dict[str, Any] = {"look_limit_s": part.limit_s, "look_park_mm": part.park_mm}
    interval = look_interval(part.every)
    if interval.measure == "vessel" and not embedded:  # no vessel ends in a layered job
        return {**care, "look_after": MarkKind.LAYER}
    if interval.measure in ("layer", "vessel"):
        return {**care, "look_after": MarkKind(interval.measure)}
    if interval.measure in ("written_way", "written_time"):  # what ends is looked at all the same
        care["look_after"] = MarkKind.VESSEL if embedded else MarkKind.LAYER
    return {**care, _CARE[interval.measure]: interval.amount}


def unlooked_words(context: RunContext) -> str:
    """Say that a job is over before `every` asks for a look; empty where it isn't, as planned.

    By the dry run's time: an interval by the clock may be met by a print that takes longer.
    """
    part = context.recipe.observe
    if part is None or not (context.folder / GCODE).is_file():
        return ""
    care = Care(**look_care(part, embedded=isinstance(context.recipe.toolpath, Embedded)))
    job = load_job(context.folder / GCODE, context.printer)
    places = look_places(job.lines, job.marks, (), within=bool(care.look_every_mm))
    planned_s = context.manifest.stages["dry run"].summary["duration_s"]
    if care.look_every_s and care.look_every_s <= planned_s:
        return ""
    if care.look_after is not None and job.marks.of(care.look_after):
        return ""
    if places.next_due(0, Written(), care) is not None:
        return ""
    return (
        f"NOBODY LOOKS at it: the print ({planned_s:.0f} s by the dry run) is over before "
        f"observe.every, {part.every}, asks for a look; say layer or less"
    )


def order_observer(context: RunContext) -> None:
    """Write beside a run's G-code how its print is observed, whoever prints it; or that it isn't.

    `printctl run` and the page start the observer with the print
    (`printctl.observe.observer_launch`).
    """
    part, folder = context.recipe.observe, context.folder
    if part is None:
        (folder / ORDER_FILE).unlink(missing_ok=True)
    elif (folder / GCODE).is_file():
        _order(context, part).save(folder)


def observed_otherwise(context: RunContext, print_folder: Path) -> bool:
    """Whether a print that goes on is observed otherwise than the recipe says by now."""
    begun, now = (folder / ORDER_FILE for folder in (print_folder, context.folder))
    order_observer(context)
    return begun.is_file() and (not now.is_file() or begun.read_bytes() != now.read_bytes())


def _order(context: RunContext, part: ObservePart) -> ObserverOrder:
    recipe, folder = context.recipe, context.folder
    write_network_csv(folder / NETWORK_FILE, context.written_network)
    syringe = context.syringe
    x, y, z = context.place_mm.tolist()
    return ObserverOrder(
        job=str((folder / GCODE).resolve()),
        profile=recipe.printer.profile,
        syringe=recipe.printer.syringe,
        ink=recipe.printer.ink,
        needle=recipe.toolpath.needle,
        embedded=isinstance(recipe.toolpath, Embedded),
        oct=part.device == "oct",
        laser=part.device == "laser_line",
        frame="" if part.frame is None else str((context.recipe_folder / part.frame).resolve()),
        device=device_settings(context, part),
        capacity_ul=usable_mm(syringe, context.printer) * syringe.area_mm2,
        network=str((folder / NETWORK_FILE).resolve()),
        place_mm=(x, y, z),
        limits=_limits(part),
        care=look_care(part, embedded=isinstance(recipe.toolpath, Embedded)),
    )


def _limits(part: ObservePart) -> Limits:
    low, high = part.flow_factor
    said = part.tolerance
    return Limits(
        gap=GapTest(least_mm=said.gap_mm),
        flow=FlowLimits(low=low, high=high),
        width_percent=said.width_percent,
        lumen_percent=said.lumen_percent,
        shift_mm=said.shift_mm,
        unseen_mm=said.unseen_mm,
        mend=part.mend,
        costs=Costs(**part.costs.model_dump()),
    )


def device_settings(context: RunContext, part: ObservePart) -> DeviceSettings:
    """Return how an observer takes a picture: by a camera, folder, program or simulated device."""
    limit_s = PICTURE_TIME_SHARE * part.limit_s
    if not part.source:
        return DeviceSettings("simulated", limit_s=limit_s, extra=_twin(context, part))
    tables = part.device == "laser_line"
    if "{out}" in part.source:
        return DeviceSettings("command", part.source, limit_s=limit_s, tables=tables)
    place = context.recipe_folder / part.source
    if part.device != "camera" or place.is_dir() or part.source.endswith("/"):
        return DeviceSettings("folder", str(place.resolve()), limit_s=limit_s, tables=tables)
    frame = read_frame(context.recipe_folder / str(part.frame))
    return DeviceSettings("camera", part.source, frame.lens.size_px, limit_s)


def _twin(context: RunContext, part: ObservePart) -> dict[str, str]:
    """Files of the simulated device, which looks straight at the part from above."""
    low, high = context.written_bounds + context.place_mm
    recipe = context.recipe
    embedded = isinstance(recipe.toolpath, Embedded)
    laid = {
        "printer": recipe.printer.profile,
        "syringe": recipe.printer.syringe,
        "ink": recipe.printer.ink,
        "style": "embedded" if embedded else "layered",
        "layer_mm": None if embedded else getattr(recipe.toolpath, "even_layer_mm", None),
    }
    box = (low - _MARGIN_MM, high + _MARGIN_MM)
    seen = {
        "camera": lambda: _camera_view(*box, embedded),
        "oct": lambda: _oct_view(*box),
        "laser_line": lambda: _laser_view(*box),
    }[part.device]()
    path = context.folder / DEVICE_FILE
    write_text(path, yaml.safe_dump({**seen, "laid": laid}, sort_keys=False))
    record = str((context.folder / EXECUTED).resolve())
    found = {part.device: str(path.resolve()), "record": record}
    if recipe.printer.faults is not None:
        found["faults"] = str((context.recipe_folder / recipe.printer.faults).resolve())
    return found


def _camera_view(low: FloatArray, high: FloatArray, embedded: bool) -> dict[str, Any]:
    """A camera over a box, and ink with a dye; filaments lie below the bath's surface."""
    middle, top = (low + high) / 2, float(high[2]) - _MARGIN_MM
    bath = {"bath": {"surface_z_mm": top}} if embedded else {}
    return {
        "camera": {
            "size_px": [_PICTURE_PX, _PICTURE_PX],
            "um_per_px": 1000.0 * float((high - low)[:2].max()) / _PICTURE_PX,
            "target_mm": [float(middle[0]), float(middle[1]), top],
            "tilt_deg": 8.0,
            "distortion": [-0.08, 0.02, 0.0005, -0.0003, 0.0],
        },
        "scene": {"ink": {"colour": [70, 90, 150], "density_per_mm": 4.0}, **bath},
    }


def _laser_view(low: FloatArray, high: FloatArray) -> dict[str, Any]:
    """A laser profiler over a box; the plate lies where the part begins."""
    plate = float(low[2]) + _MARGIN_MM
    side = max(_OCT_SIDE_UM, 1000.0 * float((high - low)[:2].max()) / _LASER_ACROSS)
    box = {"low_mm": low.tolist(), "high_mm": high.tolist()}
    return {**box, "plate_z_mm": plate, "pixel_um": [side, side]}


def _oct_view(low: FloatArray, high: FloatArray) -> dict[str, Any]:
    """A scan of a box, from a little above what is printed."""
    top = [float(high[0]), float(high[1]), float(high[2]) - _MARGIN_MM + _ABOVE_MM]
    side = max(_OCT_SIDE_UM, 1000.0 * float((high - low)[:2].max()) / _OCT_ACROSS)
    return {"low_mm": low.tolist(), "high_mm": top, "voxel_um": [side, side, _OCT_DEEP_UM]}
