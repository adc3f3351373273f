"""Compute the systematic wall offset of a kind of scan from a phantom; write and read its file.

A segmentation moves every wall by about the same: the instrument's blur, the bright line where
light meets gel, the level taken for halfway. On a part whose channels are known that offset is
measured; in scans of the same device, voxels and material it can then be taken out.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.special import stdtrit

from design.files import write_text
from firmware_profiles.yaml_file import read_yaml
from registration.errors import RegistrationError

SCHEMA = "printctl-walls-1"
MOST_UM = 100.0
"""No segmentation worth correcting is further off."""


@dataclass(frozen=True)
class WallCalibration:
    """Systematic wall offset of a kind of scan.

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
    """

    offset_um: float
    interval_um: float
    from_um: float
    to_um: float
    scans: int


def measured_walls(
    known_um: list[NDArray[np.float64]], measured_um: list[NDArray[np.float64]]
) -> WallCalibration:
    """Offset from scans of a phantom: one array of vessels' diameters each, known and measured.

    Scans are what repeats independently, so the interval is Student's over scans; of a single
    scan it is that over its vessels, which share what its pose and its speckle did.

    Raises
    ------
    RegistrationError
        When there are too few vessels, or the offset is no segmentation's.
    """
    errors = [(known - measured) / 2 for known, measured in zip(known_um, measured_um, strict=True)]
    errors = [each[np.isfinite(each)] for each in errors]
    values = np.array([each.mean() for each in errors]) if len(errors) > 1 else errors[0]
    if len(values) < 2 or any(len(each) == 0 for each in errors):
        raise RegistrationError(
            f"{len(values)} measured vessel(s) tell no offset; scan a phantom of several channels, "
            "or scan it several times"
        )
    offset = float(values.mean())
    if abs(offset) > MOST_UM:
        raise RegistrationError(
            f"walls are {offset:.0f} um off (limit {MOST_UM:g} um): that is another part, another "
            "unit, or a scan whose voxel size is wrong"
        )
    spread = float(values.std(ddof=1)) / math.sqrt(len(values))
    known = np.concatenate(known_um)
    return WallCalibration(
        offset_um=offset,
        interval_um=float(stdtrit(len(values) - 1, 0.975)) * spread,
        from_um=float(known.min()),
        to_um=float(known.max()),
        scans=len(errors),
    )


def write_walls(path: Path, walls: WallCalibration) -> None:
    """Write a file that `read_walls` reads back.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written.
    """
    plain = {name: round(value, 4) for name, value in asdict(walls).items()}
    write_text(path, yaml.safe_dump({"schema": SCHEMA, **plain}, sort_keys=False))


def read_walls(path: Path) -> WallCalibration:
    """Read a calibration of walls.

    Raises
    ------
    RegistrationError
        When the file is missing, isn't one, or holds an impossible number.
    """
    try:
        data = read_yaml(path.read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError, UnicodeDecodeError) as exc:
        raise RegistrationError(
            f"{path}: no calibration of walls there ({type(exc).__name__}); write one with "
            "printctl calibrate walls"
        ) from exc
    if not isinstance(data, dict) or data.pop("schema", None) != SCHEMA:
        raise RegistrationError(f"{path}: isn't a calibration of walls (schema {SCHEMA})")
    names = set(WallCalibration.__annotations__)
    plain = all(isinstance(v, int | float) and math.isfinite(v) for v in data.values())
    if set(data) != names or not plain:
        raise RegistrationError(f"{path}: must hold the numbers {', '.join(sorted(names))}")
    walls = WallCalibration(**{**data, "scans": int(data["scans"])})
    if abs(walls.offset_um) > MOST_UM or walls.interval_um < 0:
        raise RegistrationError(
            f"{path}: offset_um is {walls.offset_um:g} and interval_um {walls.interval_um:g}; an "
            f"offset lies within {MOST_UM:g} um, an interval above 0; calibrate again"
        )
    return walls
