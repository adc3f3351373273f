"""Stage 8: the scan, from a file or simulated from what the simulated printer deposited."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from design.files import write_text
from printctl.pipeline.context import RunContext
from printctl.pipeline.manifest import digest_file
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.printing import EXECUTED
from printctl.pipeline.stages.toolpath import GCODE
from printctl.progress import Report
from printctl.recipe.making import FileScan, SimulatedScan
from registration import Scan, read_scan, write_scan_tiff
from registration.readers import ScanOverrides
from sim.deposit import deposit
from sim.deposit_air import pneumatic_deposit
from sim.executed import ExecutedMotion
from sim.scanner import (
    MicroCtOptions,
    OctOptions,
    Placing,
    Scanned,
    simulate_microct,
    simulate_oct,
)

SCAN, TRUTH = "scan.tif", "scan_truth.json"

_NAMES = {"oct": "OCT", "microct": "micro-CT"}

_FINEST_DEPOSIT_MM = 0.02
_DEPOSIT_PER_SCAN_VOXEL = 0.625
"""The deposit is laid somewhat finer than it is scanned, so that its own voxels don't show."""


def depends(context: RunContext) -> Any:
    """The section, the seed and what the plunger lays; the user's file where it names one."""
    part = context.scan_part
    found = part.model_dump(mode="json")
    if isinstance(part, FileScan):
        path = context.recipe_folder / part.file
        return [found, digest_file(path) if path.is_file() else ""]
    laid = [context.syringe.inner_mm, context.ink.flow_factor, context.flow_ul_s]
    return [found, context.recipe.seed, *laid]


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Scan, or read the user's scan once to see that it can be used."""
    part = context.scan_part
    if isinstance(part, FileScan):
        return describe(load_scan(context), part.file), []
    scanned = simulate(context, part, report)
    report(0.8, "writing")
    scan = to_scan(scanned, context)
    write_scan_tiff(context.folder / SCAN, scan)
    write_truth(context, scanned)
    return describe(scan, f"simulated {_NAMES[part.simulated]}"), [SCAN, TRUTH]


def simulate(context: RunContext, part: SimulatedScan, report: Report) -> Scanned:
    """Lay the ink where the printer's motors went, and scan it."""
    dx, dy, dz = (value * 1e-3 for value in part.voxel_um)
    # What comes out for a way of the plunger: the writer pushes more where less comes out.
    area = math.pi / 4 * context.syringe.inner_mm**2 * context.ink.flow_factor
    fine = max(_FINEST_DEPOSIT_MM, _DEPOSIT_PER_SCAN_VOXEL * min(dx, dy, dz))
    motion = ExecutedMotion.load(context.folder / EXECUTED)
    if context.flow_ul_s is None:
        ink = deposit(motion, area, fine, plunger_step_mm=1 / context.printer.steps_per_mm.e)
    else:
        gcode = (context.folder / GCODE).read_bytes()
        ink = pneumatic_deposit(motion, gcode, context.printer, context.flow_ul_s, fine)
    report(0.4, "scanning")
    left = 1 - part.shrink_percent / 100
    seed = part.seed if part.seed is not None else context.recipe.seed
    if part.simulated == "oct":
        placing = Placing(shrink=(left, left, left))
        return simulate_oct(ink, OctOptions(voxel_mm=(dz, dy, dx), placing=placing), seed)
    placing = Placing(tilt_deg=5.0, rotation_deg=180.0, margin_mm=1.0, shrink=(left, left, left))
    return simulate_microct(ink, MicroCtOptions(voxel_mm=dx, placing=placing), seed)


def to_scan(scanned: Scanned, context: RunContext) -> Scan:
    """What a scanner's file holds: everything but the truth."""
    return Scan(
        volume=scanned.volume,
        voxel_mm=scanned.voxel_mm,
        refractive_index=scanned.refractive_index,
        optical_depth=scanned.optical_depth,
        scale=scanned.scale,
        modality=scanned.modality,
        depth_down=scanned.depth_down,
        came_from=context.folder / SCAN,
    )


def write_truth(context: RunContext, scanned: Scanned) -> None:
    """Keep where the part really lay, in a file that registration never opens."""
    truth = {
        "printer_to_scan": scanned.pose_truth.tolist(),
        "shrink": scanned.shrink_truth.tolist(),
    }
    write_text(context.folder / TRUTH, json.dumps(truth, indent=1) + "\n")


def load_scan(context: RunContext) -> Scan:
    """The scan of this run: the user's, or the simulated one read back from its file."""
    part = context.scan_part
    if isinstance(part, SimulatedScan):
        return read_scan(context.folder / SCAN)
    size = part.voxel_um
    voxel = (size[2] * 1e-3, size[1] * 1e-3, size[0] * 1e-3) if size else None
    overrides = ScanOverrides(
        voxel_mm=voxel, refractive_index=part.refractive_index, modality=part.modality
    )
    return read_scan(context.recipe_folder / part.file, overrides)


def describe(scan: Scan, source: str) -> dict[str, Any]:
    """What the report says of a scan."""
    dz, dy, dx = scan.geometric_voxel_mm
    return {
        "source": source,
        "modality": _NAMES.get(scan.modality, scan.modality),
        "voxel_um": [dx * 1e3, dy * 1e3, dz * 1e3],
        "shape": list(scan.volume.shape[::-1]),
        "refractive_index": scan.refractive_index,
        "optical_depth": scan.optical_depth,
        "intensity": scan.scale,
    }


def reads(context: RunContext) -> tuple[str, ...]:
    """The executed motion and the G-code, where the scan is simulated from them."""
    return (EXECUTED, GCODE) if isinstance(context.scan_part, SimulatedScan) else ()


STAGE = Stage("scan", depends, reads, ("kernels", "sim", "registration/readers"), work)
