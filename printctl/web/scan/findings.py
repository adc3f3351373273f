"""Read a registration's verdict, alignment and vessel rows from files, for the Scan page."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from printctl.history.table import Outcome, outcome
from printctl.web.errors import NotFoundError


@dataclass(frozen=True)
class VesselFinding:
    """One vessel as it was gauged; None where nothing was seen."""

    vessel: str
    kind: str
    designed_um: float | None
    measured_um: float | None
    error_percent: float | None
    rms_um: float | None
    offset_um: float | None
    verdict: str


@dataclass(frozen=True)
class AlignmentFigure:
    """A figure of the alignment, with its unit and interval."""

    name: str
    value: str


@dataclass(frozen=True)
class Findings:
    """Verdict, alignment and vessels of a registration.

    ``outcome`` is ``pass``, ``fail``, ``undecided`` (neither is proven), or empty and ``passed``
    None where no verdict was written; ``reasons`` are the verdict's.
    """

    outcome: Outcome
    passed: bool | None
    undecided: bool
    reasons: tuple[str, ...]
    alignment: tuple[AlignmentFigure, ...]
    vessels: tuple[VesselFinding, ...]


def findings(folder: Path) -> Findings:
    """Read what a registration in a folder found.

    Raises
    ------
    NotFoundError
        When there is none.
    """
    numbers = _read(folder / "registration.json")
    if numbers is None:
        raise NotFoundError(f"no scan is registered in {folder.name} yet")
    numbers = numbers.get("registration", numbers)
    judged = (_read(folder / "report.json") or numbers).get("verdict", {})
    return Findings(
        found := outcome(judged),
        judged.get("passed"),
        found == "undecided",
        tuple(str(one) for one in judged.get("reasons", ())),
        tuple(alignment(numbers)),
        tuple(_vessel(row) for row in numbers.get("vessels", ())),
    )


def _read(path: Path) -> dict[str, Any] | None:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return data if isinstance(data, dict) else None


def alignment(numbers: Mapping[str, Any]) -> list[AlignmentFigure]:
    """Return pose, scales and deviations with their 95 % intervals."""
    matrix = np.array(numbers["transform_scan_to_part"], dtype=float)
    ci = numbers.get("interval_95") or {}
    turn = np.rad2deg(np.arccos(np.clip((np.trace(matrix[:3, :3]) - 1) / 2, -1, 1)))
    rows = [("Turned by", f"{turn:.2f}° {_plus(ci.get('rotation_deg'), 1.0, '°')}")]
    shift = ", ".join(f"{value:.3f}" for value in matrix[:3, 3]).replace("-", "−")
    rows.append(("Shifted by x, y, z", f"{shift} mm {_plus(ci.get('shift_um'), 1.0, 'µm')}"))
    scale = numbers.get("scale") or []
    more = [f"{100 * (1 / float(s) - 1):+.2f} %".replace("-", "−") for s in scale]
    sizes, wide = (f"{100 * float(s):.2f} %" for s in scale), _plus(ci.get("scale"), 100.0, "%")
    rows.append(("Part against design along x, y, z", f"{', '.join(sizes)} {wide}"))
    rows.append(("That is, to come out right, stretch by", ", ".join(more)))
    for key, name in (("rigid", "RMS deviation, rigid fit"), ("scaled", "RMS deviation, scaled")):
        fit = numbers.get(key) or {}
        if "rms_um" in fit:
            spread = f"{fit['rms_um']:.1f} µm; 95 % of it within {fit['p95_um']:.1f} µm"
            rows.append((name, spread))
    flag = (numbers.get("ambiguity") or {}).get("flag")
    if flag is not None:
        symmetry = (numbers.get("judging") or {}).get("symmetry")
        doubt = "ambiguous: another fits as well"
        if symmetry:
            doubt = f"the design is the same after {' or '.join(symmetry['motions'])}"
        rows.append(("Pose", doubt if flag else "unambiguous"))
    return [AlignmentFigure(name, value.strip()) for name, value in rows]


def _plus(values: Any, factor: float, unit: str) -> str:
    """The widest of a few intervals."""
    if not values:
        return ""
    return f"(± {factor * max(float(v) for v in values):.2g} {unit}, 95 %)"


def _vessel(row: Mapping[str, Any]) -> VesselFinding:
    if row.get("open") is False:
        verdict = "closed"
    elif row.get("measured_um") is None:
        verdict = "not seen"
    else:
        verdict = "open" if row.get("open") else "not seen from end to end"
    decision = row.get("decision")
    names = ("designed_um", "measured_um", "error_percent", "rms_um", "offset_um")
    return VesselFinding(
        vessel=str(row.get("name") or row.get("vessel", "")),
        kind=str(row.get("kind", "")),
        verdict=verdict if decision is None else f"{decision}: {verdict}",
        **{name: _number(row.get(name)) for name in names},
    )


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None
