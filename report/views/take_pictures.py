"""Take pictures of vessel sections and findings from the scan; add the voxel of each finding."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from design.geometry.surface import Surface
from kernels.arrays import FloatArray
from registration.measuring.judging import list_findings
from registration.overlay.cut import Shades
from registration.scan import Scan
from report.views.findings import Contours, FindingView, half_window, panel
from report.views.stack import SectionStack, section_stack

if TYPE_CHECKING:
    from design.solids import Solid
    from registration.result import RegistrationReport

Record = Mapping[str, Any]

MOST_FINDINGS = 40
"""With pictures, fails first; each is about 60 kB of a page."""
_SEVERE = {"fail": 0, "undecided": 1, "pass": 2}


@dataclass(frozen=True)
class Views:
    """Pictures of one registration.

    Attributes
    ----------
    sections : SectionStack
    findings : tuple of FindingView
        By their place in the list of findings; at most `MOST_FINDINGS`.
    finding_count : int
        Findings there are.
    root : bool
        Whether grey is the root of the scan's values (amplitude).
    raw : bool
        False where the scan was laid out anew (beam, refraction) before it was measured.
    """

    sections: SectionStack
    findings: tuple[FindingView, ...]
    finding_count: int
    root: bool
    raw: bool


def take_views(
    scan: Scan, model: Solid, report: RegistrationReport, numbers: Record, raw: bool = True
) -> Views:
    """Take the pictures of all sections, and of the findings.

    Parameters
    ----------
    scan : Scan
        As it was measured.
    model : Solid
        The design that it was held against, part frame.
    report : RegistrationReport
    numbers : dict
        Its numbers as judged.
    raw : bool
        Whether the scan's voxels are the file's own.
    """
    shades = Shades.of(scan)
    stack = section_stack(scan, shades, report.vessels, numbers["vessels"])
    findings = list_findings(numbers)
    ranked = sorted(
        range(len(findings)), key=lambda k: _SEVERE.get(str(findings[k]["decision"]), 1)
    )
    contours = _contours(model, report)
    views = [
        _view(k, findings[k], scan, shades, contours, report, stack)
        for k in sorted(ranked[:MOST_FINDINGS])
    ]
    return Views(stack, tuple(views), len(findings), shades.root, raw)


def _contours(model: Solid, report: RegistrationReport) -> Contours:
    back = _inverse(report.scaled_scan_to_part)
    rigid = _inverse(report.transform_scan_to_part)
    return Contours(
        Surface(_moved(np.asarray(model.vertices, np.float64), back), model.faces),
        Surface(_moved(report.surface.vertices, rigid), report.surface.faces),
    )


def _inverse(motion: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(motion), dtype=np.float64)


def _moved(points: FloatArray, motion: FloatArray) -> FloatArray:
    return np.asarray(points @ motion[:3, :3].T + motion[:3, 3])


def add_scan_places(numbers: Record, scan: Scan, report: RegistrationReport) -> None:
    """Put ``scan_place`` to each finding of judged numbers: where to look in the scan's file."""
    for finding in numbers["findings"]:
        finding["scan_place"] = scan_place(scan, report, finding)


def scan_place(scan: Scan, report: RegistrationReport, finding: Record) -> dict[str, int]:
    """Return the voxel of a finding: B-scan, A-scan and depth, counted from 0."""
    point = np.array([finding["point_mm"]], dtype=np.float64)
    where = _moved(point, _inverse(report.scaled_scan_to_part))[0]
    voxel = np.rint(where / np.array(scan.geometric_voxel_mm[::-1])).astype(int)
    i, j, k = np.clip(voxel, 0, np.array(scan.volume.shape[::-1]) - 1).tolist()
    return {"b_scan": j, "a_scan": i, "depth": k}


def _view(
    number: int,
    finding: Record,
    scan: Scan,
    shades: Shades,
    contours: Contours,
    report: RegistrationReport,
    stack: SectionStack,
) -> FindingView:
    place = scan_place(scan, report, finding)
    voxel = (place["a_scan"], place["b_scan"], place["depth"])
    vessel = report.vessels[int(finding["vessel"])]
    extent = float(finding["to_mm"]) - float(finding["from_mm"])
    half = half_window(vessel.designed_um / 2e3, extent)
    return FindingView(
        number,
        panel(scan, shades, contours, 1, voxel, half),
        panel(scan, shades, contours, 0, voxel, half),
        _section(finding, vessel.along_mm, stack),
    )


def _section(finding: Record, along: FloatArray, stack: SectionStack) -> int | None:
    """The nearest section with a picture, where one lies within two spacings of the finding."""
    vessel = int(finding["vessel"])
    has: Sequence[int] = stack.index[stack.vessel == vessel].tolist()
    if not has:
        return None
    away = np.abs(along[has] - float(finding["at_mm"]))
    spacing = float(np.median(np.diff(along))) if len(along) > 1 else 0.5
    if away.min() > 2 * spacing:
        return None
    return stack.find(vessel, has[int(away.argmin())])
