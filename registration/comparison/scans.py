"""Extract the numbers to compare from a registration.json; refuse different designs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from kernels.arrays import FloatArray
from registration.errors import RegistrationError
from registration.json_ready import Record


class ComparisonError(RegistrationError):
    """Registrations that can't be compared; the message says which, why and what to do."""


class GaugeStudyError(ComparisonError):
    """Operators, parts and repeats that don't make a crossed study."""


AXES: Final = ("x", "y", "z")
_NEEDED: Final = ("vessels", "defects", "scale", "offset_um", "interval_95", "scaled", "rigid")


@dataclass(frozen=True)
class GaugedScan:
    """A scan that was held against its design.

    Attributes
    ----------
    label : str
        What the reader knows it by.
    design : str
        Digest of the design's network.
    print_id : str
        Two scans with the same are scans of one print.
    started : float or None
        When the print began, s since 1970; None where nobody wrote it down.
    passed : bool or None
        Its verdict; None where none was given.
    undecided : bool
        Neither pass nor fail is proven.
    reasons : tuple of str
        Of the verdict.
    designed_um, measured_um, length_mm : (v,) float64
        Of each vessel; NaN where it wasn't measured. Closed vessels aren't a diameter: NaN.
    open : tuple of (bool or None)
        Of each vessel.
    sections : tuple of (along_mm, diameter_um)
        Of each vessel.
    unseen_mm : tuple of lists of (from, to)
        Of each vessel.
    scale, scale_half : (3,) float64
        Size over the design's along x, y, z, and half of the 95 % interval; NaN: not fitted.
    offset_um, offset_half_um : float
    rms_um, rigid_rms_um : float
        Deviation after the scaled and the rigid fit.
    defects : tuple of mapping
        As in registration.json.
    offsets_um, type_a_um, width_um : (v,) float64
        Of each vessel: offset of its axis; standard uncertainty of its diameter from the budget's
        type A terms; median width of its diameter's tolerance. NaN what isn't known.
    operator, part : str or None
        As the registration's record names them.
    """

    label: str
    design: str
    print_id: str
    started: float | None
    passed: bool | None
    undecided: bool
    reasons: tuple[str, ...]
    designed_um: FloatArray
    measured_um: FloatArray
    length_mm: FloatArray
    open: tuple[bool | None, ...]
    sections: tuple[tuple[FloatArray, FloatArray], ...]
    unseen_mm: tuple[Sequence[Sequence[float]], ...]
    scale: FloatArray
    scale_half: FloatArray
    offset_um: float
    offset_half_um: float
    rms_um: float
    rigid_rms_um: float
    defects: tuple[Record, ...]
    offsets_um: FloatArray
    type_a_um: FloatArray
    width_um: FloatArray
    operator: str | None = None
    part: str | None = None

    @property
    def error_um(self) -> FloatArray:
        """Measured less designed diameter of each vessel, (v,), µm."""
        return self.measured_um - self.designed_um


@dataclass(frozen=True)
class Origin:
    """Where numbers come from; the fields are those of `GaugedScan`."""

    label: str
    design: str
    print_id: str
    started: float | None = None
    passed: bool | None = None
    undecided: bool = False
    reasons: tuple[str, ...] = ()
    operator: str | None = None
    part: str | None = None


def gauged_scan(numbers: Record, origin: Origin) -> GaugedScan:
    """Take out of a registration's numbers what is compared.

    Raises
    ------
    ComparisonError
        When something is missing, or isn't what it should be.
    """
    missing = [key for key in _NEEDED if key not in numbers]
    if missing:
        raise ComparisonError(
            f"{origin.label}: its registration lacks {', '.join(missing)}; it was written by an "
            "older version, or isn't one: register the scan again"
        )
    try:
        return _gauged(numbers, origin)
    except (KeyError, TypeError, ValueError, IndexError) as exc:
        raise ComparisonError(
            f"{origin.label}: its registration is broken ({type(exc).__name__}: {exc}); register "
            "the scan again"
        ) from exc


def _gauged(numbers: Record, origin: Origin) -> GaugedScan:
    vessels, interval = numbers["vessels"], numbers["interval_95"]
    if not vessels or [row["vessel"] for row in vessels] != list(range(len(vessels))):
        raise ValueError("its vessels aren't numbered from 0 without a gap")
    if any(len(row["along_mm"]) != len(row["diameter_um"]) for row in vessels):
        raise ValueError("a vessel's sections differ in number from their places")
    if not all(_is_defect(row, len(vessels)) for row in numbers["defects"]):
        raise ValueError("a defect lacks its kind, vessel, extent or size")
    measured = _numbers([row["measured_um"] for row in vessels])
    return GaugedScan(
        **vars(origin),
        designed_um=_numbers([row["designed_um"] for row in vessels]),
        measured_um=np.where(measured > 0, measured, np.nan),
        length_mm=_numbers([row["length_mm"] for row in vessels]),
        open=tuple(row["open"] for row in vessels),
        sections=tuple(
            (_numbers(row["along_mm"]), _numbers(row["diameter_um"])) for row in vessels
        ),
        unseen_mm=tuple(row["unseen_mm"] for row in vessels),
        scale=_numbers(numbers["scale"]),
        scale_half=_numbers(interval["scale"]),
        offset_um=float(_numbers([numbers["offset_um"]])[0]),
        offset_half_um=float(_numbers([interval["offset_um"]])[0]),
        rms_um=float(numbers["scaled"]["rms_um"]),
        rigid_rms_um=float(numbers["rigid"]["rms_um"]),
        defects=tuple(numbers["defects"]),
        offsets_um=_numbers([row.get("offset_um") for row in vessels]),
        type_a_um=np.array([_type_a(row) for row in vessels]),
        width_um=np.array([_width(row) for row in vessels]),
    )


def _type_a(row: Record) -> float:
    """Root sum of squares of a vessel's type A terms, µm; NaN without a budget."""
    terms = [term["standard"] for term in row.get("budget") or () if term["type"] == "A"]
    return float(np.sqrt(np.sum(np.square(terms)))) if terms else float("nan")


def _width(row: Record) -> float:
    low, high = _numbers(row.get("lower_um") or ()), _numbers(row.get("upper_um") or ())
    wide = (high - low)[np.isfinite(high - low)]
    return float(np.median(wide)) if len(wide) else float("nan")


def _is_defect(row: Record, vessels: int) -> bool:
    sizes = [row[name] for name in ("from_mm", "to_mm", "size_um")]
    known = all(isinstance(size, int | float) for size in sizes)
    return known and isinstance(row["kind"], str) and row["vessel"] in range(vessels)


def _numbers(values: Sequence[Any]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def check_comparable(scans: Sequence[GaugedScan]) -> None:
    """Refuse fewer than two scans, or scans of different designs.

    Raises
    ------
    ComparisonError
        With the folders of each design.
    """
    if len(scans) < 2:
        raise ComparisonError("a comparison takes two registrations or more; name another")
    designs: dict[str, list[str]] = {}
    for scan in scans:
        designs.setdefault(scan.design, []).append(scan.label)
    if len(designs) > 1:
        designs_text = "; ".join(
            f"{key[:12]}: {', '.join(names)}" for key, names in designs.items()
        )
        raise ComparisonError(
            f"these are prints of {len(designs)} different designs (digests of their "
            f"network.csv: {designs_text}); compare prints of one design"
        )
    counts = {scan.label: len(scan.designed_um) for scan in scans}
    if len(set(counts.values())) > 1:
        designs_text = ", ".join(f"{label}: {count}" for label, count in counts.items())
        raise ComparisonError(
            f"the registrations differ in their number of vessels ({designs_text})"
        )
