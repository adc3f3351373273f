"""Order scans by print and compute the comparison: quantities, vessels, defects, gauge study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from registration.comparison.defects import SharedDefect, shared_defects
from registration.comparison.errors import GaugeStudyError
from registration.comparison.gauge import GaugeStudy, gauge_study
from registration.comparison.overall import (
    DAY_S,
    Quantity,
    Repeatability,
    quantities,
    repeatability,
)
from registration.comparison.scans import GaugedScan, check_comparable
from registration.comparison.vessels import VesselSpread, vessel_spreads


@dataclass(frozen=True)
class Print:
    """One print and its scans.

    Attributes
    ----------
    label : str
        Of its first scan.
    print_id : str
    started : float or None
        s since 1970.
    scans : tuple of int
        Its scans, counted from 0 in the comparison's order.
    passed : bool or None
        True where every scan that has a verdict passed; None where none has one.
    undecided : bool
        Not passed, though no scan of it failed.
    """

    label: str
    print_id: str
    started: float | None
    scans: tuple[int, ...]
    passed: bool | None
    undecided: bool


@dataclass(frozen=True)
class Comparison:
    """Several prints of one design.

    Attributes
    ----------
    scans : tuple of GaugedScan
        By print, in order.
    prints : tuple of Print
        In the order of time where every print has one; else as they were given.
    by_time : bool
        Which of the two.
    tolerance_percent : float or None
        Of diameters; None: no capability.
    quantities : tuple of Quantity
    repeatability : Repeatability
    vessels : tuple of VesselSpread
    defects : tuple of SharedDefect
    gauge : GaugeStudy or None
        None: not asked for.
    """

    scans: tuple[GaugedScan, ...]
    prints: tuple[Print, ...]
    by_time: bool
    tolerance_percent: float | None
    quantities: tuple[Quantity, ...]
    repeatability: Repeatability
    vessels: tuple[VesselSpread, ...]
    defects: tuple[SharedDefect, ...]
    gauge: GaugeStudy | None = None

    def quantity(self, name: str) -> Quantity:
        """The quantity of that name."""
        return next(q for q in self.quantities if q.name == name)


def compare(
    scans: Sequence[GaugedScan], tolerance_percent: float | None = None, gauge: bool = False
) -> Comparison:
    """Compare prints of one design.

    Parameters
    ----------
    scans : sequence of GaugedScan
        Two or more; scans with the same ``print_id`` are scans of one print.
    tolerance_percent : float or None
        A vessel's diameter may be off by so much; asks for capability.
    gauge : bool
        Whether the scans are a gauge study: operators x parts x repeats.

    Raises
    ------
    ComparisonError
        For fewer than two, or for different designs.
    GaugeStudyError
        When the scans don't make a gauge study.
    """
    check_comparable(scans)
    by_time, groups = _ordered(scans)
    ordered = [scan for group in groups for scan in group]
    number = [k for k, group in enumerate(groups) for _ in group]
    prints, at = [], 0
    for group in groups:
        prints.append(_print(group, at))
        at += len(group)
    vessels = vessel_spreads(ordered, number, tolerance_percent)
    return Comparison(
        scans=tuple(ordered),
        prints=tuple(prints),
        by_time=by_time,
        tolerance_percent=tolerance_percent,
        quantities=quantities(ordered, number, _days(prints) if by_time else None),
        repeatability=repeatability(vessels, number),
        vessels=vessels,
        defects=shared_defects(ordered, number),
        gauge=_gauge(ordered, [prints[k].label for k in number]) if gauge else None,
    )


def _gauge(scans: Sequence[GaugedScan], labels: Sequence[str]) -> GaugeStudy:
    """Run the study; a scan without an operator's name is refused where others have one."""
    operators = [scan.operator for scan in scans]
    unnamed = [scan.label for scan in scans if scan.operator is None]
    if unnamed and len(unnamed) < len(scans):
        raise GaugeStudyError(
            f"no operator is named for {', '.join(unnamed[:4])}, though for other scans; name all "
            "with --operators A,A,B,..., or in each scan's record"
        )
    return gauge_study(
        scans,
        [name or "not stated" for name in operators],
        [scan.part or label for scan, label in zip(scans, labels, strict=True)],
    )


def _ordered(scans: Sequence[GaugedScan]) -> tuple[bool, list[list[GaugedScan]]]:
    """Scans by print; prints by time where all of them have one."""
    groups: dict[str, list[GaugedScan]] = {}
    for scan in scans:
        groups.setdefault(scan.print_id, []).append(scan)
    starts = [_started(group) for group in groups.values()]
    known = [start for start in starts if start is not None]
    if len(known) < len(starts):
        return False, list(groups.values())
    order = sorted(range(len(known)), key=lambda k: known[k])
    listed = list(groups.values())
    return True, [listed[k] for k in order]


def _started(group: Sequence[GaugedScan]) -> float | None:
    return next((scan.started for scan in group if scan.started is not None), None)


def _print(group: Sequence[GaugedScan], at: int) -> Print:
    verdicts = [scan.passed for scan in group if scan.passed is not None]
    return Print(
        label=group[0].label,
        print_id=group[0].print_id,
        started=_started(group),
        scans=tuple(range(at, at + len(group))),
        passed=all(verdicts) if verdicts else None,
        undecided=any(s.undecided for s in group)
        and all(s.undecided for s in group if s.passed is False),
    )


def _days(prints: Sequence[Print]) -> list[float]:
    first = prints[0].started or 0.0
    return [((each.started or 0.0) - first) / DAY_S for each in prints]
