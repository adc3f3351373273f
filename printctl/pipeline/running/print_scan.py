"""Simulate the scan of any print that was made on the simulated printer."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from design.files import write_text
from design.network_files.csv_format import read_network_csv
from firmware_profiles import Ink, Needle, Printer, Syringe, load, steady_flow
from firmware_profiles.errors import wording
from gcode.deposit.ink_faults import NO_FAULTS
from gcode.deposit.lay import Style
from gcode.motion.executed import ExecutedMotion
from printctl.checks.gcode_view.line_map import mapped_style
from printctl.checks.set_up import of_each
from printctl.errors import UsageError
from printctl.machine.job.job import grown_text, parse_job
from printctl.machine.process.simulated import EXECUTED, record_for
from printctl.machine.records.record import JOURNAL, load_record
from printctl.machine.records.replay import grown_in
from printctl.pipeline.context import LIGHT_REACHES_MM
from printctl.pipeline.past.evidence import Evidence, evidence
from printctl.pipeline.past.past_print import PrintEntry
from printctl.pipeline.simulated_scan import (
    PrintedInk,
    deposit_voxel_mm,
    scan_deposit,
    scan_size_words,
    to_scan,
    usual_voxel_um,
)
from printctl.pipeline.stages.scan import describe, write_truth
from printctl.recipe import Recipe
from printctl.recipe.sections.measuring import SimulatedScan
from printctl.run_folder.artefacts import NETWORK
from registration.files.readers import metadata
from registration.files.writers import write_scan
from sim.devices.faults import FaultFile
from sim.devices.recorded_ink import read_record


@dataclass(frozen=True)
class StatedPrint:
    """What the user says of a print; None for as it was printed.

    Attributes
    ----------
    syringe, ink, needle : str or None
        Profiles, with commas between those of several heads.
    faults : Path or None
        Fault file of the simulated printer.
    record : Path or None
        Its record of what its motors did.
    embedded : bool or None
        Whether filaments were written into a bath; else layers.
    layer_um : float or None, µm
        Height of the only layer.
    """

    syringe: str | None = None
    ink: str | None = None
    needle: str | None = None
    faults: Path | None = None
    record: Path | None = None
    embedded: bool | None = None
    layer_um: float | None = None


def scan_print(
    entry: PrintEntry,
    stated: StatedPrint,
    wanted: Mapping[str, Any],
    out: Path | None,
    tell: Callable[[str], None],
) -> dict[str, Any]:
    """Simulate a print's scan; write it, its sidecar and the true pose; return facts.

    Parameters
    ----------
    entry : PrintEntry
    stated : StatedPrint
    wanted : mapping
        Fields of `SimulatedScan`; None for its default.
    out : Path or None
        The scan's file; ``scan.tif`` in the print's folder by default.
    tell : function of str
        Is told how large the scan will be before it is made.

    Raises
    ------
    UsageError
        When what the motors did isn't known, or the scan is too large.
    """
    folder = entry.journal.parent
    path = folder / "scan.tif" if out is None else out
    known = evidence(entry)
    recipe = Recipe.model_validate(known.facts["recipe"]) if "recipe" in known.facts else None
    motion = read_record(_record(entry, stated.record))
    style, layer_mm = _style(known, recipe, stated)
    ink = replace(_ink(known, recipe, motion, stated), style=style, layer_mm=layer_mm)
    box, layered = ink.written_mm, ink.is_layered
    if style is None:
        told = (
            "all of it is level, so it is simulated as layers (--embedded: as filaments)"
            if layered
            else "it isn't level, so it is simulated as filaments in a bath (--layered: as layers)"
        )
        tell(f"note: no recipe and no line map (FILE.map.npz) says how this was written; {told}")
    deep = not layered or float(np.ptp(box, axis=0)[2]) > LIGHT_REACHES_MM
    part = _part({**wanted, "simulated": wanted["simulated"] or ("microct" if deep else "oct"),
                  "format": path.suffix[1:].lower() or "tif"})  # fmt: skip
    seed = part.seed or 0
    if part.voxel_um is None:
        usual = usual_voxel_um(part, _thinnest_mm(folder / NETWORK), box, seed)
        part = part.model_copy(update={"voxel_um": usual})
    tell(scan_size_words(part, box, seed, "--large"))
    stays = layered or (recipe is not None and recipe.toolpath.written == "cords")
    scanned = scan_deposit(ink.deposit(deposit_voxel_mm(part)), part, seed, gel=stays)
    scan = to_scan(scanned, path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_scan(path, scan)
    sidecar, truth = path.with_suffix(".json"), path.with_name(f"{path.stem}_truth.json")
    stated_of_scan = {"axes": "zyx", **metadata.metadata_of(scan)}
    write_text(sidecar, json.dumps(stated_of_scan, indent=1) + "\n")
    write_truth(truth, scanned)
    return {
        "print": entry.id,
        "scan": str(path),
        "sidecar": str(sidecar),
        "truth": str(truth),
        **describe(scan, f"simulated scan of {entry.file}"),
    }


def _style(
    known: Evidence, recipe: Recipe | None, stated: StatedPrint
) -> tuple[Style | None, float | None]:
    """Whether layers or filaments were written, and a single layer's height, mm; None: unknown."""
    layer_mm = None if stated.layer_um is None else stated.layer_um * 1e-3
    if stated.embedded is not None:
        return "embedded" if stated.embedded else "layered", layer_mm
    if recipe is not None:
        style, own_mm = recipe.toolpath.style
        return style, own_mm if layer_mm is None else layer_mm
    if known.gcode is None:
        return None, layer_mm
    return mapped_style(known.gcode.with_suffix(".map.npz")), layer_mm


def _part(wanted: Mapping[str, Any]) -> SimulatedScan:
    given = {key: value for key, value in wanted.items() if value is not None}
    try:
        return SimulatedScan(**given)
    except ValidationError as exc:
        raise UsageError("; ".join(wording(one) for one in exc.errors())) from exc


def _thinnest_mm(network: Path) -> float | None:
    """Diameter of the thinnest vessel of a print's design, where its folder holds that."""
    if not network.is_file():
        return None
    return 2 * float(read_network_csv(network, unit="mm").radius.min())


def _record(entry: PrintEntry, given: Path | None) -> Path:
    """Return the file of what the motors did in a print.

    Raises
    ------
    UsageError
        When there is none of this print.
    """
    if given is not None:
        return given
    folder = entry.journal.parent
    found = [path for path in (folder / EXECUTED, record_for(folder)) if path.is_file()]
    if not found:
        raise UsageError(
            f"what the motors did in this print isn't recorded ({folder / EXECUTED} isn't there): "
            "only a print on the simulated printer (--port simulated) can be scanned so; of one "
            "that was started with `printctl sim-printer --record FILE`, give --record FILE"
        )
    if entry.journal.name != JOURNAL or found[0].stat().st_mtime < entry.started:
        raise UsageError(
            f"{found[0]} is of another print than {entry.id} in the same folder; print it again "
            "on the simulated printer in a folder of its own, or give --record"
        )
    return found[0]


def _ink(
    known: Evidence, recipe: Recipe | None, motion: ExecutedMotion, stated: StatedPrint
) -> PrintedInk:
    """Return what the heads held while the motors moved so.

    Raises
    ------
    UsageError
        When the print's own files don't say it and the user doesn't either.
    """
    printer = load(Printer, known.entry.profile)
    syringes, inks, needles = _named(known, recipe, stated, printer)
    faults = stated.faults
    if recipe is not None and faults is None and recipe.printer.faults is not None:
        raise UsageError(
            f"the print was made with the faults in {recipe.printer.faults}, which decide where "
            "its ink lies; give that file (--faults)"
        )
    if recipe is not None and getattr(recipe.toolpath, "compensate_lag", False):
        raise UsageError(
            "the print's E runs ahead of its ink's lag, so it doesn't say by itself where ink "
            "lies; have the run scan it: a scan section in its recipe (scan: {simulated: "
            "microct}) and `printctl run RECIPE` again, which prints nothing anew"
        )
    flows, gcode = [], b""
    if printer.airs:
        if not all(needles):
            raise UsageError(
                f"what flows while the valve of {printer.name} is open follows from ink and "
                "needle; give --needle, and --ink unless it was collagen_fresh"
            )
        flows = [
            steady_flow(air, load(Ink, ink), load(Needle, needle or "")).ul_s
            for air, ink, needle in zip(printer.airs, inks, needles, strict=True)
        ]
        gcode = _sent(known, printer)
    areas = [
        load(Syringe, syringe).area_mm2 * load(Ink, ink).flow_factor
        for syringe, ink in zip(syringes, inks, strict=True)
    ]
    wrong = NO_FAULTS if faults is None else FaultFile.load(faults).of_ink
    return PrintedInk(motion, printer, areas, flows, gcode, wrong)


def _named(
    known: Evidence, recipe: Recipe | None, stated: StatedPrint, printer: Printer
) -> tuple[list[str], list[str], list[str | None]]:
    """Names of each head's syringe, ink and needle: as stated, of the recipe, or of the print."""
    count = printer.head_count
    if recipe is not None:
        part, needle = recipe.printer, recipe.toolpath.needle
        held = part.heads or (part,) * count
        syringes, inks = [one.syringe for one in held], [one.ink for one in held]
        needles = [getattr(one, "needle", None) or needle for one in held]
    else:
        care = load_record(known.entry.journal.parent).care
        syringes = list(care.get("head_syringes") or [care.get("syringe", "")] * count)
        inks, needles = ["collagen_fresh"] * count, [None] * count
    if stated.syringe is not None:
        syringes = of_each(printer, stated.syringe, "--syringe")
    if stated.ink is not None:
        inks = of_each(printer, stated.ink, "--ink")
    if stated.needle is not None:
        needles = list(of_each(printer, stated.needle, "--needle"))
    if not all(syringes):
        raise UsageError("the print's record doesn't say which syringe it had; give --syringe")
    return syringes, inks, needles


def _sent(known: Evidence, printer: Printer) -> bytes:
    """Return the G-code as it was sent, with what was put in."""
    if known.gcode is None:
        raise UsageError(f"when the valve stood open isn't known: {'; '.join(known.missing)}")
    data = known.gcode.read_bytes()
    job = grown_in(known.entry.journal.parent, parse_job(data, known.gcode.name, printer))
    return b"".join(grown_text(job, data).lines)
