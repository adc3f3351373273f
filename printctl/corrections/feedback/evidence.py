"""Read a registered print as input for a compensation; record which run made a scanned part."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from design.files import write_bytes
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv
from design.solids import read_solid
from design.toolpath.correction import Corrections, Stretch
from printctl.corrections.compensation import (
    DesignPart,
    PrintConditions,
    PrintPart,
    corrections_of_file,
    load_compensation,
)
from printctl.corrections.compensation.schema import Three
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
