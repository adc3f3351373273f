"""Start the observer of a run's print, as the recipe's section ``observe`` says."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any, Final

import yaml

from design.files import write_text
from design.network_files.csv_format import write_network_csv
from printctl.errors import UsageError
from printctl.link.detached_process import spawn
from printctl.link.marks import MarkKind
from printctl.observe.deciding import FlowLimits, GapTest, Limits
from printctl.observe.devices import DeviceSettings
from printctl.observe.order import ObserverOrder
from printctl.pipeline.context import RunContext
from printctl.printing import usable_mm
from printctl.printing.executed_note import EXECUTED
from printctl.recipe.making import Embedded
from printctl.recipe.observe import ObservePart
from printctl.run_folder.artefacts import GCODE

NETWORK_FILE: Final = "observed_network.csv"
CAMERA_FILE: Final = "simulated_camera.yaml"
_MARGIN_MM: Final = 2.0
_PICTURE_PX: Final = 2000
_INTERVAL: Final = re.compile(r"(\d+(?:\.\d+)?) *(mm|min|s)")
_SECONDS: Final = {"min": 60.0, "s": 1.0}


def look_care(part: ObservePart | None) -> dict[str, Any]:
    """When the print is held for a look, for `printctl.link.Care`."""
    if part is None:
        return {}
    care: dict[str, Any] = {"look_limit_s": part.limit_s, "look_park_mm": part.park_mm}
    found = _INTERVAL.fullmatch(part.every)
    if found is None:
        return {**care, "look_after": MarkKind(part.every)}
    number, unit = float(found[1]), found[2]
    if unit == "mm":
        return {**care, "look_every_mm": number}
    return {**care, "look_every_s": number * _SECONDS[unit]}


def refuse_unobservable(context: RunContext) -> None:
    """Refuse what an observer can't do, before anything is made.

    Raises
    ------
    UsageError
    """
    part, printer = context.recipe.observe, context.printer
    if part is None:
        return
    if printer.heads or printer.pneumatic is not None:
        raise UsageError(
            f"observe: {printer.name} has several heads or a valve, and mends are written for one "
            "plunger; leave observe out"
        )
    if context.recipe.plate is not None:
        raise UsageError("observe: a plate's prints can't be observed yet; leave observe out")
    simulated = context.recipe.printer.port == "simulated"
    if part.device == "simulated" and not simulated:
        raise UsageError(
            f"observe: device simulated sees the simulated printer, but port is "
            f"{context.recipe.printer.port}; name a camera or a folder"
        )


def start_observer(context: RunContext, folder: Path) -> None:
    """Start an observer in the print's folder; it ends with the print."""
    part = context.recipe.observe
    if part is None:
        return
    _order(context, part, folder).save(folder)
    spawn([sys.executable, "-m", "printctl.observe", str(folder.resolve()), "--detach"])


def _order(context: RunContext, part: ObservePart, folder: Path) -> ObserverOrder:
    recipe = context.recipe
    write_network_csv(folder / NETWORK_FILE, context.written_network)
    syringe = context.syringe
    x, y, z = context.place_mm.tolist()
    return ObserverOrder(
        job=str((context.folder / GCODE).resolve()),
        profile=recipe.printer.profile,
        syringe=recipe.printer.syringe,
        ink=recipe.printer.ink,
        needle=recipe.toolpath.needle,
        embedded=isinstance(recipe.toolpath, Embedded),
        frame="" if part.frame is None else str((context.recipe_folder / part.frame).resolve()),
        device=_device(context, part, folder),
        capacity_ul=usable_mm(syringe, context.printer) * syringe.area_mm2,
        network=str((folder / NETWORK_FILE).resolve()),
        place_mm=(x, y, z),
        limits=_limits(part),
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
        mend=part.mend,
    )


def _device(context: RunContext, part: ObservePart, folder: Path) -> DeviceSettings:
    limit_s = 0.8 * part.limit_s
    if part.device == "simulated":
        return DeviceSettings("simulated", limit_s=limit_s, extra=_twin(context, folder))
    if part.device == "camera":
        return DeviceSettings("camera", part.source, limit_s=limit_s)
    if part.device == "folder":
        source = str((context.recipe_folder / part.source).resolve())
        return DeviceSettings("folder", source, limit_s=limit_s)
    return DeviceSettings("command", part.source, limit_s=limit_s)


def _twin(context: RunContext, folder: Path) -> dict[str, str]:
    """Files of the simulated camera, which looks straight at the part from above."""
    low, high = context.written_bounds + context.place_mm
    wide = float((high - low)[:2].max()) + 2 * _MARGIN_MM
    middle = ((low + high) / 2).tolist()
    recipe = context.recipe
    style = "embedded" if isinstance(recipe.toolpath, Embedded) else "layered"
    layer = None if style == "embedded" else getattr(recipe.toolpath, "even_layer_mm", None)
    said = {
        "camera": {
            "size_px": [_PICTURE_PX, _PICTURE_PX],
            "um_per_px": 1000.0 * wide / _PICTURE_PX,
            "target_mm": [middle[0], middle[1], float(high[2])],
            "tilt_deg": 8.0,
            "distortion": [-0.08, 0.02, 0.0005, -0.0003, 0.0],
        },
        "scene": {"ink": {"colour": [70, 90, 150], "density_per_mm": 4.0}},  # ink with a dye
        "laid": {
            "printer": recipe.printer.profile,
            "syringe": recipe.printer.syringe,
            "ink": recipe.printer.ink,
            "style": style,
            "layer_mm": layer,
        },
    }
    path = folder / CAMERA_FILE
    write_text(path, yaml.safe_dump(said, sort_keys=False))
    found = {"camera": str(path.resolve()), "record": str((context.folder / EXECUTED).resolve())}
    if recipe.printer.faults is not None:
        found["faults"] = str((context.recipe_folder / recipe.printer.faults).resolve())
    return found
