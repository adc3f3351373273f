"""Add operator, instrument, certificate, temperature to a registration's JSON; warn if invalid."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import date, datetime
from typing import Any

from printctl.recipe.sections.record import RecordPart
from registration.scan import Scan
from registration.wall_reference import WallCalibration, differing


@dataclass(frozen=True)
class Corrections:
    """What was asked to be taken out of a scan.

    Attributes
    ----------
    optics : str or None
        File of the OCT's calibration.
    air_above : bool
        Refraction at the sample's surface.
    """

    optics: str | None = None
    air_above: bool = False


def add_record(
    numbers: dict[str, Any], stated: RecordPart, scan: Scan, done: Corrections, now: datetime
) -> None:
    """Put the record under ``record`` and its notes to the others.

    Parameters
    ----------
    numbers : dict
        Of a registration; changed.
    stated : RecordPart
    scan : Scan
    done : Corrections
    now : datetime
        With time zone; the scan's age counts from it.
    """
    certificate = stated.certificate
    corrected, left = _corrections(scan, done)
    numbers["record"] = {
        "part": stated.part,
        "material": stated.material,
        "operator": stated.operator,
        "instrument": stated.instrument,
        "serial": stated.serial,
        "certificate": certificate.model_dump(mode="json"),
        "scanned": stated.scanned,
        "age_at_registration_h": _age_h(stated, now),
        "temperature_c": stated.temperature_c,
        "temperature_range_c": stated.temperature_range_c and list(stated.temperature_range_c),
        "corrected": corrected,
        "not_corrected": left,
        "tolerance_source": stated.tolerance_source,
        "decision_rule": numbers["judging"]["rule"],
    }
    numbers["notes"] = [*numbers.get("notes", []), *record_notes(stated, now)]
    numbers["notes"] += _reference_notes(stated, scan.walls)


def _reference_notes(stated: RecordPart, walls: WallCalibration | None) -> list[str]:
    """Return in what the reference of the walls was another than the part, as records say."""
    known = {} if walls is None else asdict(walls)
    here = stated.model_dump(include={"instrument", "material"})
    return [
        f"The walls' offset was measured with {name} {known[name]}, and this scan states "
        f"{here[name]}: whether it holds isn't known; scan the reference so too"
        for name in differing(known, here)
    ]


def _age_h(stated: RecordPart, now: datetime) -> float | None:
    if stated.scanned is None:
        return None
    age = now - datetime.fromisoformat(stated.scanned)
    return round(age.total_seconds() / 3600, 2)


def _corrections(scan: Scan, done: Corrections) -> tuple[list[str], list[str]]:
    """What was corrected, and what wasn't, in words."""
    light = scan.modality == "oct"
    index = f"depth divided by the group index {scan.refractive_index:g}"
    refraction = "refraction at the sample's surface"
    beam = "beam's fan and bow"
    rows = [
        (scan.lateral_error is not None, f"{beam}, by {done.optics}", beam),
        (done.air_above, refraction, refraction),
        (scan.optical_depth, index, "depth by the index (the file's depth counts as geometric)"),
        (scan.depth_standard, "depth by a standard of known height", "depth by a standard"),
        (True, "bright lines of reflections at walls, as far as they were seen", ""),
    ] if light else []  # fmt: skip
    rows.append((True, "diameters by the blur of the segmentation", ""))
    walls = "place of the walls"
    rows.append((scan.walls is not None, f"{walls}, by a reference of known diameters", walls))
    rows.append((False, "", "temperature (lengths are those of the part as it was scanned)"))
    rows.append((False, "", "shrinkage: the rigid fit shows it, the scaled fit takes it out"))
    return [yes for was, yes, _ in rows if was], [no for was, _, no in rows if not was]


def record_notes(stated: RecordPart, now: datetime) -> list[str]:
    """Return what speaks against the measurement: certificate, temperature, time."""
    made = []
    when = None if stated.scanned is None else datetime.fromisoformat(stated.scanned)
    day, until = (when or now).date(), stated.certificate.valid_until
    if until is not None and date.fromisoformat(until) < day:
        what = "scan" if when else "registration (no time of the scan is stated)"
        made.append(
            f"The instrument's certificate ended on {until}, before the {what} of "
            f"{day.isoformat()}; have it calibrated again"
        )
    span, degrees = stated.temperature_range_c, stated.temperature_c
    if span is not None and degrees is not None and not span[0] <= degrees <= span[1]:
        made.append(
            f"The temperature of {degrees:g} °C is outside the stated range of {span[0]:g} to "
            f"{span[1]:g} °C; lengths and index may differ from those assumed"
        )
    if when is not None and when > now:
        made.append(
            f"The stated time of the scan, {stated.scanned}, lies after its registration; mend "
            "the record or the clock"
        )
    return made
