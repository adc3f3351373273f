"""Stage 8: read the user's scan, or simulate a scan of the simulated print."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from design.files import write_text
from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselNetwork
from gcode.bead.predict import laid_bead
from gcode.deposit.ink_faults import NO_FAULTS, InkFaults
from gcode.deposit.lay import Deposit, deposit_of_laid
from gcode.dry_run.run import dry_run
from gcode.motion.executed import ExecutedMotion
from kernels.arrays import FloatArray
from printctl.errors import RecipeError
from printctl.pipeline.context import RunContext
from printctl.pipeline.simulated_scan import (
    PrintedInk,
    deposit_voxel_mm,
    reach_notes,
    scan_deposit,
    scan_size_words,
    to_scan,
    usual_voxel_um,
)
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.paths.predicting import compensates, predicted_of_motion
from printctl.pipeline.stages.printing import EXECUTED, printed_text
from printctl.progress import Report
from printctl.recipe.sections.defects import (
    BulgePart,
    DefectPart,
    LeakPart,
    MissingPart,
    OcclusionPart,
    StenosisPart,
)
from printctl.recipe.sections.measuring import FileScan, SimulatedScan
from printctl.run_folder.artefacts import GCODE, LINE_MAP, NETWORK
from printctl.run_folder.manifest import digest_file, of_simulator
from registration import Scan, ScanOverrides, read_scan
from registration.corrected import corrected_scan
from registration.errors import RegistrationError
from registration.files.readers import is_mosaic, listed_files
from registration.files.writers import write_scan
from sim.devices.faults import FaultFile
from sim.devices.scanner.defects import Defect, with_defects
from sim.devices.scanner.placing import ScannerOutput

_WIDER = 1.25
"""Gel fills a lumen to so much of its designed radius: lines may have left it wider."""


def scan_defects(
    parts: Sequence[DefectPart], network: VesselNetwork, place_mm: FloatArray
) -> list[Defect]:
    """Defects in the printer's frame.

    Parameters
    ----------
    parts : sequence of DefectPart
        As the recipe gives them.
    network : VesselNetwork
        The design, part frame.
    place_mm : (3,) mm
        Part to printer.

    Raises
    ------
    RecipeError
        When there is no such vessel.
    """
    return [_defect(part, network, place_mm) for part in parts]


def _defect(part: DefectPart, network: VesselNetwork, place: FloatArray) -> Defect:
    if part.vessel >= network.vessel_count:
        raise RecipeError(
            f"scan.defects: a {part.defect} is ordered in vessel {part.vessel}, but the network "
            f"has vessels 0 to {network.vessel_count - 1}; give one of those"
        )
    points, radii = network.polyline(part.vessel)
    path = points + place
    upto = arc_lengths(points)
    if isinstance(part, MissingPart):
        return Defect("missing", path, _WIDER * float(radii.max()))
    at = part.at * float(upto[-1])
    radius = float(np.interp(at, upto, radii))
    match part:
        case BulgePart():
            side = None if part.towards is None else np.array(part.towards)
            height = part.height_um * 1e-3
            return Defect("bulge", path, radius, at, part.length_mm, height, side=side)
        case StenosisPart():
            left = 1 - part.percent / 100
            return Defect("stenosis", path, radius, at, part.length_mm, left=left)
        case OcclusionPart():
            return Defect("occlusion", path, _WIDER * radius, at, part.length_mm)
        case LeakPart():
            begin = places_along(path, upto, np.array(at))
            way = np.stack([begin, np.array(part.to) + place])
            return Defect("leak", way, part.diameter_um * 5e-4)


TRUTH = "scan_truth.json"
_NAMES = {"oct": "OCT", "microct": "micro-CT"}
FIELD_MM = 1.5
"""A scanner looks at the part and so far around it, not at the line that primed the needle."""
FIELD_SIDES = np.array([[-1.0], [1.0]])


def depends(context: RunContext) -> Any:
    """The section, the seed and what the plunger lays; the user's file where it names one."""
    part = context.scan_part
    section = part.model_dump(mode="json")
    if isinstance(part, FileScan):
        return [section, *digest_user_files(context.recipe_folder, part)]
    ink = context.poured.ink
    laid: list[Any] = [context.syringe.inner_mm, ink.flow_factor, context.flow_ul_s]
    if context.printer.heads:
        laid += [[one.syringe.inner_mm, one.ink.flow_factor] for one in context.loads]
    if compensates(context):
        laid += [context.ink.model_dump(mode="json"), context.needle.model_dump(mode="json")]
    faults = context.digests(context.recipe.printer.files()).values()
    return [section, context.recipe.seed, *laid, context.compensation_digest, *faults]


def scan_name(part: SimulatedScan) -> str:
    """The simulated scan's file, in the run's folder."""
    return f"scan.{part.format}"


def digest_user_files(folder: Path, part: FileScan) -> list[Any]:
    """The user's scan, and the calibrations of what made it."""
    devices = [name for name in (part.oct_calibration, part.walls) if name is not None]
    return [digest_scan(folder / name) for name in (part.file, *devices)]


def digest_scan(path: Path) -> list[str]:
    """What a user's scan is made of: a file, a folder's files, or a list and the scans it names."""
    try:
        listed = listed_files(path) if is_mosaic(path) else ()
    except RegistrationError:
        listed = ()  # reading it will say what is wrong
    return [digest for place in (path, *listed) for digest in _digests(place)]


def _digests(path: Path) -> list[str]:
    places = sorted(path.rglob("*")) if path.is_dir() else [path]
    return [digest_file(place) if place.is_file() else "" for place in places]


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Scan, or read the user's scan once to see that it can be used."""
    part = context.scan_part
    if isinstance(part, FileScan):
        facts = describe(load_scan(context), part.file)
        return facts | {"simulated": of_simulator(context.recipe_folder / part.file)}, []
    scanned = simulate(context, part, report)
    report(0.8, "writing")
    scan = to_scan(scanned, context.folder / "scan")
    write_scan(context.folder / scan_name(part), scan)
    write_truth(context.folder / TRUTH, scanned)
    facts = describe(scan, f"simulated {_NAMES[part.simulated]}")
    wrong = ink_faults(context).each
    if wrong:
        facts["ink_faults"] = [fault.fault for fault in wrong]
    if part.defects:
        ordered = [f"{defect.defect} in vessel {defect.vessel}" for defect in part.defects]
        facts["defects_on_order"] = ordered
    return facts, [scan_name(part), TRUTH]


def simulate(context: RunContext, part: SimulatedScan, report: Report) -> ScannerOutput:
    """Lay the ink where the printer's motors went, and scan it.

    Raises
    ------
    UsageError
        When the scan would be so large that the recipe must say that it may be.
    """
    seed = part.seed if part.seed is not None else context.recipe.seed
    motion = ExecutedMotion.load(context.folder / EXECUTED)
    printed = printed_ink(context, motion)
    box = printed.written_mm
    if context.recipe.toolpath.prime is not None:
        field = context.written_bounds + context.place_mm + FIELD_MM * FIELD_SIDES
        box = np.clip(box, *field)
    if part.voxel_um is None:
        thinnest = 2 * float(context.network.radius.min())
        part = part.model_copy(update={"voxel_um": usual_voxel_um(part, thinnest, box, seed)})
    context.bars.remark("scan", scan_size_words(part, box, seed, "large: true in scan"))
    gel = context.recipe.toolpath.written != "vessels"
    points = context.network.points + context.place_mm
    for note in reach_notes(part, points, box, gel=gel):
        context.bars.remark("scan", note)
    more = 1 + part.spread_percent / 100
    fine = deposit_voxel_mm(part)
    if compensates(context):
        ink = predicted_ink(context, motion, fine, more)
    else:
        ink = printed.deposit(fine, more)
    if context.recipe.toolpath.prime is not None:
        ink = ink.within(field)
    if part.defects:
        ink = with_defects(
            ink, scan_defects(part.defects, context.written_network, context.place_mm)
        )
    report(0.4, "scanning")
    return scan_deposit(ink, part, seed, gel=gel)


def printed_ink(context: RunContext, motion: ExecutedMotion) -> PrintedInk:
    """What the heads of a run held while they moved so."""
    held = context.loads if context.printer.heads else (context.poured,)
    part = context.recipe.toolpath
    return PrintedInk(
        motion,
        context.printer,
        # The writer pushes more where less comes out.
        [one.syringe.area_mm2 * one.ink.flow_factor for one in held],
        context.flows_ul_s,
        b"" if not context.flows_ul_s else b"".join(printed_text(context).lines),
        ink_faults(context),
        *part.style,
    )


def predicted_ink(
    context: RunContext, motion: ExecutedMotion, voxel_mm: float, more: float
) -> Deposit:
    """What lies in the bath where the plunger goes ahead of the ink's lag."""
    text = printed_text(context)
    gcode = b"".join(text.lines)
    x, y, z = context.start_mm.tolist()
    run = dry_run(gcode, context.printer, (x, y, z))
    bead = predicted_of_motion(context, run, gcode, motion, text.file_row).bead
    return deposit_of_laid(laid_bead(bead, math.sqrt(more), ink_faults(context)), voxel_mm)


def ink_faults(context: RunContext) -> InkFaults:
    """What the recipe's fault file does to the ink."""
    name = context.recipe.printer.faults
    return NO_FAULTS if name is None else FaultFile.load(context.recipe_folder / name).of_ink


def write_truth(path: Path, scanned: ScannerOutput) -> None:
    """Keep where the part really lay, in a file that registration never opens."""
    truth = {
        "printer_to_scan": scanned.pose_truth.tolist(),
        "shrink": scanned.shrink_truth.tolist(),
    }
    write_text(path, json.dumps(truth, indent=1) + "\n")


def load_scan(context: RunContext) -> Scan:
    """The scan of this run: the user's, or the simulated one read back from its file."""
    part = context.scan_part
    if isinstance(part, SimulatedScan):
        return read_scan(context.folder / scan_name(part))
    size = part.voxel_um
    voxel = (size[2] * 1e-3, size[1] * 1e-3, size[0] * 1e-3) if size else None
    overrides = ScanOverrides(
        voxel_mm=voxel,
        refractive_index=part.refractive_index,
        optical_depth=part.optical_depth,
        scale=part.scale,
        modality=part.modality,
        depth_down=part.depth_down,
        axes=part.axes,
        mirrored=part.mirrored,
        db_range=part.db_range,
        count_range=part.count_range,
        counts_per_db=part.counts_per_db,
        db_at_zero=part.db_at_zero,
    )
    folder = context.recipe_folder
    device, walls = (
        None if name is None else folder / name for name in (part.oct_calibration, part.walls)
    )
    return corrected_scan(folder / part.file, overrides, device, part.air_above, True, walls)


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
    part = context.scan_part
    if not isinstance(part, SimulatedScan):
        return ()
    names = (EXECUTED, GCODE, NETWORK)
    return (*names, LINE_MAP) if compensates(context) else names


STAGE = Stage("scan", depends, reads, ("kernels", "gcode", "sim", "registration"), work)
