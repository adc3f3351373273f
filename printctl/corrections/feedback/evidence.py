"""Read a registered print's excess widths and axis shifts as input of a compensation."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from design.files import write_bytes
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv
from design.solids import read_solid
from design.toolpath.correction import Corrections, Stretch
from kernels.arrays import BoolArray, FloatArray
from printctl.corrections.compensation import (
    DesignPart,
    PrintConditions,
    PrintPart,
    Three,
    corrections_of_file,
    load_compensation,
)
from printctl.errors import PrintctlError, UsageError
from printctl.run_folder.artefacts import NETWORK, NUMBERS, PRINTED_WITH, SOLID
from printctl.run_folder.manifest import MANIFEST, Manifest, digest_file, digest_json, of_simulator

ORIGIN = "made"
"""Section of what `printctl register` writes that says of which run the print was."""
NO_ORIGIN = "made_unknown"
"""The same where that isn't known: why."""


@dataclass(frozen=True)
class Print:
    """One print's numbers and what made it.

    Attributes
    ----------
    facts : PrintPart
        Where from, digests, scale.
    design : DesignPart
    made_with : PrintConditions
    network : VesselNetwork
        The design.
    base : Corrections
        What it was itself printed with; of an uncompensated one neutral.
    found : dict
        Registration's numbers.
    simulated : bool
        Its scan was simulated.
    """

    facts: PrintPart
    design: DesignPart
    made_with: PrintConditions
    network: VesselNetwork
    base: Corrections
    found: dict[str, Any]
    simulated: bool

    @property
    def name(self) -> str:
        """How messages call it."""
        return self.facts.folder


def read_print(folder: Path) -> Print:
    """Read a run folder, or a folder of `printctl register SCAN --model RUN`.

    Raises
    ------
    UsageError
        When it is neither, or isn't finished, or its files were changed since.
    PrintctlError
        When the registration can't be relied on: ambiguous pose.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder} isn't a folder; give run folders, or those of register --out")
    path = folder / NUMBERS
    if not path.is_file():
        raise UsageError(
            f"{folder} has no {NUMBERS}; finish it with `printctl run`, or give the folder of "
            "`printctl register SCAN --model RUN --out DIR`"
        )
    data = _json(path)
    if (folder / MANIFEST).is_file():
        if "registration" not in Manifest.load(folder).stages:
            raise UsageError(f"{folder}: its registration isn't done; finish it (printctl run)")
        origin: dict[str, Any] | None = origin_of(folder)
    else:
        origin = data.get(ORIGIN)
    if origin is None:
        raise UsageError(
            f"{folder}: it isn't known how the part was printed: {_why(data)}; register it anew "
            "with --model RUN, a whole run's folder"
        )
    registration = data.get("registration", data)
    _check(folder, registration)
    _check_network(folder, registration, origin["design"]["network_sha256"])
    made = folder / PRINTED_WITH if origin["compensation_sha256"] else None
    return Print(
        facts=_facts(folder, origin, registration, digest_file(path)),
        design=DesignPart(**origin["design"]),
        made_with=PrintConditions(**origin["made_with"]),
        network=read_network_csv(folder / NETWORK, unit="mm"),
        base=_base(made, origin),
        found=registration,
        simulated=bool(origin["simulated"]),
    )


def _why(data: dict[str, Any]) -> str:
    return str(data.get(NO_ORIGIN, "the scan was registered against a bare model"))


def origin_of(run: Path, read: Sequence[str] | None = None) -> dict[str, Any]:
    """What a run folder says of how its part was made, JSON-able.

    Parameters
    ----------
    run : Path
    read : sequence of str or None
        Files that must be as the run wrote them, where it wrote them; None for all that a
        compensation reads.

    Raises
    ------
    UsageError
        When the folder isn't a finished run's, or a file in it was changed since.
    """
    manifest = Manifest.load(run)
    missing = [stage for stage in ("solid", "toolpath") if stage not in manifest.stages]
    if missing:
        raise UsageError(f"{run}: its {missing[0]} isn't made; finish it with `printctl run`")
    for stage in manifest.stages.values():
        for name, digest in stage.outputs.items():
            if name in (_READ if read is None else read) and not _unchanged(run / name, digest):
                raise UsageError(
                    f"{run / name} isn't as the run wrote it; run the recipe again, so that design "
                    "and scan belong together"
                )
    outputs = manifest.stages["toolpath"].outputs
    recipe = manifest.facts["recipe"]
    return {
        "design": design_of(run).model_dump(mode="json"),
        "made_with": _made_with(manifest.facts).model_dump(mode="json"),
        "recipe_sha256": digest_json(recipe),
        "scan_sha256": _scan_digest(manifest),
        "compensation_sha256": outputs.get(PRINTED_WITH),
        "compensate": recipe["toolpath"].get("compensate"),
        "simulated": _scan_simulated(manifest),
    }


def keep_origin(run: Path, scan: Path, out: Path) -> dict[str, Any]:
    """Keep in ``out`` what a compensation needs of the run that a scanned part was made by.

    Returns
    -------
    dict
        A section for `NUMBERS`: `ORIGIN`, or, of a folder that isn't a whole run's, `NO_ORIGIN`
        with the reason. Its scan can be registered, and no more.
    """
    if not (run / MANIFEST).is_file():
        return {NO_ORIGIN: f"{run} has no {MANIFEST} of a run"}
    try:
        origin = origin_of(run, _MADE)
    except UsageError as exc:
        return {NO_ORIGIN: str(exc)}
    digest = digest_file(scan) if scan.is_file() else None
    same = bool(origin["simulated"]) and digest is not None and digest == origin["scan_sha256"]
    origin["simulated"] = same or of_simulator(scan)
    origin["scan_sha256"] = digest
    out.mkdir(parents=True, exist_ok=True)
    for name in (NETWORK, PRINTED_WITH if origin["compensation_sha256"] else None):
        if name is not None:
            write_bytes(out / name, (run / name).read_bytes())
    return {ORIGIN: origin}


def design_of(run: Path) -> DesignPart:
    """Digests and size of a run's design."""
    low, high = read_solid(run / SOLID, unit="mm").bounds
    return DesignPart(
        network_sha256=digest_file(run / NETWORK),
        solid_sha256=digest_file(run / SOLID),
        bounds_mm=(_three(low), _three(high)),
    )


SIMULATED_SCANS = ("scan.tif", "scan.oct")
"""What a run calls the file of its simulated scan."""
_MADE = (NETWORK, SOLID, PRINTED_WITH)
_READ = (*_MADE, NUMBERS)


def _unchanged(path: Path, digest: str) -> bool:
    return path.is_file() and digest_file(path) == digest


def _json(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as exc:
        raise UsageError(f"{path} isn't JSON: {exc}; register the scan again") from exc
    if not isinstance(data, dict) or "scale" not in data.get("registration", data):
        raise UsageError(f"{path} isn't a registration's; register the scan again")
    return data


def _check_network(folder: Path, numbers: dict[str, Any], designed: str) -> None:
    """Vessels are known by their numbers, which are another network's own affair."""
    gauged = numbers.get("design", {}).get("network_sha256", designed)
    if gauged != designed or not _unchanged(folder / NETWORK, designed):
        raise UsageError(
            f"{folder}: it was registered against another network than its run's (or {NETWORK} was "
            "changed since); register it anew with --model RUN alone"
        )


def _check(folder: Path, numbers: dict[str, Any]) -> None:
    rows = numbers.get("vessels") or [{}]
    if "measured_by" not in numbers or "shift_along_um" not in rows[0]:
        raise UsageError(
            f"{folder / NUMBERS} was written by an older printctl, without what a compensation "
            "needs; run the recipe (or register) again"
        )
    if (numbers.get("agreement") or {}).get("other_part"):
        raise PrintctlError(
            f"{folder}: the scan is of another part than the design; give the right scan and "
            "model, or leave this print out"
        )
    if numbers["ambiguity"]["flag"]:
        margin = numbers["ambiguity"]["margin"]
        margin_text = f" (margin {margin:.2f})" if margin is not None else ""
        raise PrintctlError(
            f"{folder}: the pose is ambiguous{margin_text}, so "
            "corrections could land on the wrong vessels; give the part marks (solid.fiducials), "
            "or leave this print out"
        )
    lay = numbers.get("lay")
    if lay and lay["depth_axis"] != "z" and not numbers["measured_by"]["depth_standard"]:
        raise PrintctlError(
            f"{folder}: the part lay {lay['words']}, so its {lay['depth_axis']} axis is the scan's "
            "depth, whose scale rests on the refractive index; scan it upright, or calibrate depth "
            "(printctl calibrate oct), or leave this print out"
        )


def _facts(folder: Path, origin: dict[str, Any], numbers: dict[str, Any], digest: str) -> PrintPart:
    return PrintPart(
        folder=folder.as_posix(),
        recipe_sha256=origin["recipe_sha256"],
        registration_sha256=digest,
        scan_sha256=origin["scan_sha256"],
        compensation_sha256=origin["compensation_sha256"],
        scale=_three(numbers["scale"]),
        scale_interval_95=tuple(numbers["interval_95"]["scale"]),
    )


def _made_with(facts: dict[str, Any]) -> PrintConditions:
    part, profiles = facts["recipe"]["toolpath"], facts["profiles"]
    return PrintConditions(
        method=part["method"],
        printer=profiles["printer"]["name"],
        needle=profiles["needle"]["name"],
        ink=profiles["ink"]["name"],
        bath=profiles["bath"]["name"],
        layer_um=part.get("layer_um"),
        line_um=part.get("line_um"),
    )


def _scan_digest(manifest: Manifest) -> str | None:
    """Of the simulated scan, or of the user's file."""
    record = manifest.stages.get("scan")
    outputs = record.outputs if record else {}
    simulated = next((d for name, d in outputs.items() if name in SIMULATED_SCANS), None)
    name = (manifest.facts["recipe"].get("scan") or {}).get("file")
    digest: str | None = simulated or manifest.facts.get("inputs", {}).get(name)
    return digest


def _scan_simulated(manifest: Manifest) -> bool:
    """A run's own, or the file of another run's."""
    record = manifest.stages.get("scan")
    own = (manifest.facts["recipe"].get("scan") or {}).get("file") is None
    return own or (record is not None and bool(record.summary.get("simulated")))


def _base(made: Path | None, origin: dict[str, Any]) -> Corrections:
    """What the print was made with: a compensation file, or the recipe's own numbers."""
    if made is not None:
        if not _unchanged(made, origin["compensation_sha256"]):
            raise UsageError(
                f"{made} isn't the one the part was printed with; run the recipe again"
            )
        return corrections_of_file(load_compensation(made))
    own = origin["compensate"] or {}
    shrunk = own.get("shrink_percent", (0.0, 0.0, 0.0))
    low, high = origin["design"]["bounds_mm"]
    about = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2])
    x, y, z = (1 / (1 - percent / 100) for percent in shrunk)
    return Corrections(Stretch((x, y, z), about), radial_mm=own.get("radial_um", 0.0) * 1e-3)


def _three(values: Any) -> Three:
    x, y, z = (float(value) for value in values)
    return (x, y, z)


# Sections whose number was withdrawn are left out. Defects (occlusions, leaks, missing vessels,
# local bulges and stenoses) are accidents of one print or faults to be mended. Their places are
# left out.
WHOLE_VESSEL = 0.8
"""A change over more of a vessel's sections than this is the vessel's own size."""
LEAST_SECTIONS = 5
"""Of a vessel that is told by itself: a few between two junctions may be the junctions'."""


@dataclass(frozen=True)
class Reading:
    """One vessel in one print, after the stretch that will be applied is taken out.

    Attributes
    ----------
    vessel : int
    diameter_mm : float, mm
        Designed, mean over the sections.
    sections : int
        Used.
    excess_mm, error_mm : float, mm
        Printed less designed diameter, and its standard error by the sections' scatter.
    ends_mm : (2, 3) float64 or None, mm
        The axis' offset, across the vessel, at its first and last node by a line through the
        sections; None where too few of them tell.
    ends_error_mm : (2,) float64, mm
        Standard errors of each component.
    """

    vessel: int
    diameter_mm: float
    sections: int
    excess_mm: float
    error_mm: float
    ends_mm: FloatArray | None
    ends_error_mm: FloatArray


def readings(print_: Print, stretch: Stretch, whole_changes: bool) -> dict[int, Reading]:
    """Every vessel of which enough was seen.

    Parameters
    ----------
    print_ : Print
    stretch : Stretch
        That the next print will be written with; diameters are told as that print's.
    whole_changes : bool
        Whether a vessel that is narrow or wide over all of its length counts as it is: several
        prints can tell that from an accident, one can't.
    """
    measured = (
        _reading(row, print_, stretch, _left_out(print_.found["defects"], row, whole_changes))
        for row in print_.found["vessels"]
    )
    return {reading.vessel: reading for reading in measured if reading is not None}


def rebase_reading(reading: Reading, print_: Print, bases: Sequence[Corrections]) -> Reading:
    """A reading as it would be, had its print been made with the mean of ``bases``."""
    vessel, wide = reading.vessel, np.array([reading.diameter_mm])

    def more(base: Corrections) -> float:
        return 2 * float(base.radial(wide)[0]) + base.diameter_mm.get(vessel, 0.0)

    def moved(base: Corrections) -> FloatArray:
        nodes = print_.network.vessel_nodes[vessel].tolist()
        return np.array([base.offset_mm.get(node, (0.0, 0.0, 0.0)) for node in nodes])

    excess = reading.excess_mm + float(np.mean([more(base) for base in bases])) - more(print_.base)
    ends = reading.ends_mm
    if ends is not None:
        ends = ends + np.mean([moved(base) for base in bases], axis=0) - moved(print_.base)
    return replace(reading, excess_mm=excess, ends_mm=ends)


def _reading(
    row: dict[str, Any], print_: Print, stretch: Stretch, left_out: BoolArray
) -> Reading | None:
    vessel = int(row["vessel"])
    along = np.array(row["along_mm"], dtype=np.float64)
    measured = np.array(row["diameter_um"], dtype=np.float64) * 1e-3
    noise = np.nan_to_num(np.array(row["noise_um"], dtype=np.float64) * 1e-3)
    kept = np.isfinite(measured) & (measured > 0) & ~left_out & _not_withdrawn(row)
    if not kept.any():
        return None
    designed, way = _designed(print_.network, vessel, along[kept])
    ratio = stretch.across(way) / print_.base.stretch.across(way)
    excess = measured[kept] * ratio - designed
    worth = _worth(along[kept], float(designed.mean()))
    scatter = float(np.std(excess, ddof=1)) if kept.sum() > 1 else 0.0
    own = float(np.sqrt(np.mean(noise[kept] ** 2)))
    shift = np.array(row["shift_along_um"], dtype=np.float64).reshape(-1, 3)[kept] * 1e-3
    ends, ends_error = _ends(along[kept], shift, float(row["length_mm"]), worth)
    return Reading(
        vessel=vessel,
        diameter_mm=float(designed.mean()),
        sections=int(kept.sum()),
        excess_mm=float(excess.mean()),
        error_mm=float(np.hypot(scatter, own if kept.sum() < 3 else 0.0) / np.sqrt(worth)),
        ends_mm=ends,
        ends_error_mm=ends_error,
    )


def _not_withdrawn(row: dict[str, Any]) -> BoolArray:
    """Sections whose diameter has an interval: a number that was withdrawn corrects nothing."""
    count = len(row["along_mm"])
    halves = row.get("interval_95_um") or [0.0] * count  # an older registration's
    return np.array([half is not None for half in halves], dtype=np.bool_)


def _worth(along: FloatArray, diameter: float) -> float:
    """How many sections' worth there is: what is nearer than a diameter errs together."""
    span = float(np.ptp(along))
    return max(1.0, min(float(len(along)), span / diameter))


def _designed(
    network: VesselNetwork, vessel: int, along: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Designed diameter (n,) and unit direction (n, 3) at distances along a vessel."""
    points, radius = network.polyline(vessel)
    ways = np.diff(points, axis=0)
    steps = np.linalg.norm(ways, axis=1)
    path = np.concatenate([[0.0], np.cumsum(steps)])
    piece = np.clip(np.searchsorted(path, along, side="right") - 1, 0, len(steps) - 1)
    way = ways[piece] / np.maximum(steps[piece], 1e-12)[:, None]
    return 2 * np.interp(along, path, radius), np.asarray(way)


def _ends(
    along: FloatArray, shift: FloatArray, length: float, worth: float
) -> tuple[FloatArray | None, FloatArray]:
    """Offset at both ends by least squares, and standard errors of its components."""
    known = np.isfinite(shift).all(axis=1)
    if known.sum() < LEAST_SECTIONS:
        return None, np.full(2, np.inf)
    s, y = along[known] - along[known].mean(), shift[known]
    square = float((s**2).sum())
    slope = (s[:, None] * y).sum(axis=0) / max(square, 1e-12)
    rest = y - y.mean(axis=0) - s[:, None] * slope
    scatter = float(np.sqrt((rest**2).sum() / max(2 * (len(s) - 2), 1)))
    at = np.array([0.0, length]) - along[known].mean()
    ends = y.mean(axis=0) + at[:, None] * slope
    spread = at**2 / max(square / len(s), 1e-12)
    return ends, scatter * np.sqrt((1 + spread) / worth)


def _left_out(
    defects: Sequence[dict[str, Any]], row: dict[str, Any], whole_changes: bool
) -> BoolArray:
    """Sections in a defect or at its brink; not those beyond a limit as their whole vessel is."""
    along = np.array(row["along_mm"], dtype=np.float64)
    out = np.zeros(len(along), dtype=np.bool_)
    reach = float(np.median(np.diff(along))) if len(along) > 1 else 0.0
    for defect in defects:
        if row["vessel"] not in (defect["vessel"], defect["other"]):
            continue
        if not defect.get("local", True):
            continue  # as the rest of its vessel: what is to be corrected
        if defect["kind"] in ("leak", "bridge"):
            # Its place along the other vessel isn't given: none of that is used.
            whole = defect["vessel"] != row["vessel"]
            near = np.abs(along - defect["at_mm"]) < 3 * reach + defect["size_um"] * 1e-3
            out |= np.ones_like(out) if whole else near
            continue
        change = defect["kind"] in ("bulge", "stenosis")
        if change and whole_changes and _within(along, defect, reach).mean() > WHOLE_VESSEL:
            continue
        # Of a run with changes within it only these differ from the rest of their vessel.
        for part in defect.get("changes", (defect,)):
            out |= _within(along, part, reach)
    return out


def _within(along: FloatArray, extent: dict[str, Any], reach: float) -> BoolArray:
    return (along > extent["from_mm"] - reach) & (along < extent["to_mm"] + reach)
