"""Measure a scan's systematic wall offset on a reference of known diameters (substitution method).

A segmentation moves every wall by about the same: the instrument's blur, the bright line where
light meets gel, the level taken for halfway. On a part whose channels are known that offset is
measured; in scans of the same device, voxels and material it can then be taken out.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from registration.errors import RegistrationError

MOST_UM = 100.0
"""No segmentation worth correcting is further off."""
SAME_VOXEL = 0.1
"""Relative difference up to which voxels are of one size: an index read otherwise, or the device's
scales, change a size by a few per cent."""


@dataclass(frozen=True)
class WallCalibration:
    """Systematic wall offset of a kind of scan; what isn't known of the kind is None.

    Attributes
    ----------
    offset_um : float, µm
        How much further into the gel walls truly lie: above 0 where lumens came out too narrow.
    interval_um : float, µm
        Half width of its 95 % interval.
    from_um, to_um : float, µm
        Diameters it was measured on.
    scans : int
        Scans it was measured on.
    voxel_um : (float, float, float) or None, µm
        Geometric voxel of those scans, as x, y, z.
    modality : str or None
        As of `Scan`.
    instrument, material : str or None
        As their measurement records name them.
    """

    offset_um: float
    interval_um: float
    from_um: float
    to_um: float
    scans: int
    voxel_um: tuple[float, float, float] | None = None
    modality: str | None = None
    instrument: str | None = None
    material: str | None = None


@dataclass(frozen=True)
class ReferenceScan:
    """What a registered scan of a reference has measured.

    Attributes
    ----------
    known_um, measured_um : (n,) float64, µm
        Mean diameters of the lumens.
    kind : dict
        `WallCalibration`'s fields on the kind of scan.
    """

    known_um: NDArray[np.float64]
    measured_um: NDArray[np.float64]
    kind: dict[str, Any]


def read_reference(path: Path) -> ReferenceScan:
    """Read a report folder of `printctl register`, or its registration.json.

    Raises
    ------
    RegistrationError
        When there is none, its walls were moved already, or the scan is of another part.
    """
    path = path / "registration.json" if path.is_dir() else path
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        part = data.get("registration", data)
        rows = [v for v in part["vessels"] if v["open"] and v["sections"] > 0 and v["measured_um"]]
        scan, record = part["measured_by"], part.get("record") or {}
        found = ReferenceScan(
            np.array([v["designed_um"] for v in rows], dtype=float),
            np.array([v["measured_um"] for v in rows], dtype=float),
            {
                "modality": scan["modality"],
                "voxel_um": tuple(map(float, scan["voxel_um"])),
                "instrument": record.get("instrument"),
                "material": record.get("material"),
            },
        )
        moved, other = part.get("walls"), (part.get("agreement") or {}).get("other_part")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as exc:
        raise RegistrationError(
            f"{path}: no registration.json of a scan is there, or it is damaged or an older "
            "version's; give the folder that `printctl register --out` wrote"
        ) from exc
    if moved is not None or other or not rows:
        why = (
            "its walls were moved by a reference already; register it without that"
            if moved is not None
            else "the scan is of another part than the model"
            if other
            else "no lumen was measured in it"
        )
        raise RegistrationError(f"{path}: {why}")
    return found


def measured_walls(scans: Sequence[ReferenceScan], u_um: float = 0.0) -> WallCalibration:
    """Offset from scans of a reference whose diameters are known within `u_um` (U, k = 2), µm.

    Scans are what repeats independently, so the interval is Student's over scans; of a single
    scan it is that over its lumens, which share what its pose and its speckle did. All known
    diameters may be off together.

    Raises
    ------
    RegistrationError
        When the scans are of different kinds, too few or the same, or their offset is no
        segmentation's.
    """
    from scipy.special import stdtrit  # pages that name a scan start without SciPy

    kind = scans[0].kind
    for scan in scans:
        for name in differing(kind, scan.kind):
            raise RegistrationError(
                f"scans of the reference differ in {name}, {kind[name]} and {scan.kind[name]}: "
                "each kind of scan has its own offset; calibrate them apart"
            )
    if len({scan.measured_um.tobytes() for scan in scans}) < len(scans):
        raise RegistrationError("one scan of the reference is given twice; give each once")
    errors = [(scan.known_um - scan.measured_um) / 2 for scan in scans]
    values = np.array([each.mean() for each in errors]) if len(errors) > 1 else errors[0]
    if len(values) < 2:
        raise RegistrationError(
            "one lumen scanned once tells no interval; scan the reference several times, moved in "
            "between (three or more: of two the interval is wide)"
        )
    offset = float(values.mean())
    if abs(offset) > MOST_UM:
        raise RegistrationError(
            f"walls are {offset:.0f} um off (limit {MOST_UM:g} um): that is another part, another "
            "unit, or a scan whose voxel size is wrong"
        )
    spread = float(values.std(ddof=1)) / math.sqrt(len(values))
    known = np.concatenate([scan.known_um for scan in scans])
    return WallCalibration(
        offset_um=offset,
        interval_um=math.hypot(float(stdtrit(len(values) - 1, 0.975)) * spread, u_um / 2),
        from_um=float(known.min()),
        to_um=float(known.max()),
        scans=len(scans),
        **kind,
    )


def differing(known: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Names of what is known of two kinds of scan and isn't the same."""
    return [
        name
        for name in ("modality", "voxel_um", "instrument", "material")
        if (one := known.get(name)) is not None
        and (two := other.get(name)) is not None
        and not (np.allclose(one, two, rtol=SAME_VOXEL) if name == "voxel_um" else one == two)
    ]
