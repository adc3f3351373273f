"""Write and read the YAML calibration file of an OCT device."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import yaml

from design.files import write_text
from firmware_profiles.yaml_file import read_yaml
from registration.devices.optics.beam import OctCalibration
from registration.errors import ScanFileError
from registration.wall_reference import MOST_UM, WallCalibration

SCHEMA = "printctl-oct-calibration-1"
OLD_WALLS = "printctl-walls-1"
"""Files that hold what now stands under `walls`."""

_MOST_BYTES = 1 << 20
_LIMITS: dict[str, tuple[int, float, float]] = {
    "lateral": (4, -2.0, 2.0),
    "fan_per_mm": (2, -0.1, 0.1),
    "bow_per_mm": (3, -0.1, 0.1),
    "depth_scale": (1, 0.5, 2.0),
    "refractive_index": (1, 1.0, 2.0),
}
_WALLS: dict[str, tuple[int, float, float]] = {
    "offset_um": (1, -MOST_UM, MOST_UM),
    "interval_um": (1, 0.0, math.inf),
    "from_um": (1, 0.0, math.inf),
    "to_um": (1, 0.0, math.inf),
    "scans": (1, 1, math.inf),
    "voxel_um": (3, 0.0, math.inf),
}


def write_calibration(path: Path, calibration: OctCalibration) -> None:
    """Write a calibration that `read_calibration` reads back exactly.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written.
    """
    plain = _plain(asdict(calibration))
    text = yaml.safe_dump({"schema": SCHEMA, **plain}, sort_keys=False, width=100)
    write_text(path, text)


def read_calibration(path: Path) -> OctCalibration:
    """Read a calibration.

    Raises
    ------
    ScanFileError
        When the file is missing, isn't one, or holds an impossible number.
    """
    if not path.is_file() or path.stat().st_size > _MOST_BYTES:
        raise ScanFileError(f"{path}: no calibration there; write one with printctl calibrate oct")
    try:
        data = read_yaml(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise ScanFileError(f"{path}: not YAML ({exc}); calibrate again") from exc
    if isinstance(data, dict) and data.get("schema") == OLD_WALLS:
        data = {"schema": SCHEMA, "walls": {k: v for k, v in data.items() if k != "schema"}}
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        raise ScanFileError(f"{path}: isn't a calibration of an OCT device (schema {SCHEMA})")
    known = set(asdict(OctCalibration()))
    unknown = sorted(str(key) for key in set(data) - known - {"schema"})
    if unknown:
        raise ScanFileError(f"{path}: unknown key {unknown[0]}; known are {', '.join(known)}")
    return _built(_all_numbers(_LIMITS, data, path), data, path)


def _built(numbers: dict[str, list[float]], data: dict[str, object], path: Path) -> OctCalibration:
    plain = OctCalibration()
    lateral = numbers.get("lateral", [1.0, 0.0, 0.0, 1.0])
    fan, bow = numbers.get("fan_per_mm", [0.0] * 2), numbers.get("bow_per_mm", [0.0] * 3)
    intervals = data.get("intervals") or {}
    standard = data.get("depth_standard", False)
    if not isinstance(standard, bool) or not isinstance(intervals, dict):
        raise ScanFileError(f"{path}: depth_standard must be true or false, intervals a mapping")
    if lateral[2] != 0 or min(lateral[0], lateral[3]) < 0.5:
        raise ScanFileError(f"{path}: lateral {lateral} isn't [[about 1, shear], [0, about 1]]")
    index = numbers.get("refractive_index")
    return OctCalibration(
        ((lateral[0], lateral[1]), (lateral[2], lateral[3])),
        (fan[0], fan[1]),
        (bow[0], bow[1], bow[2]),
        numbers.get("depth_scale", [plain.depth_scale])[0],
        index[0] if index else None,
        standard,
        {str(name): _pair(name, pair, path) for name, pair in intervals.items()},
        None if data.get("walls") is None else _walls(data["walls"], path),
    )


def _walls(data: Any, path: Path) -> WallCalibration:
    known = set(WallCalibration.__annotations__)
    needed = set(_WALLS) - {"voxel_um"}
    if not isinstance(data, dict) or not needed <= set(data) <= known:
        raise ScanFileError(f"{path}: walls must hold {', '.join(sorted(needed))}; calibrate again")
    numbers = _all_numbers(_WALLS, data, path)
    voxel = numbers.pop("voxel_um", None)
    made: dict[str, Any] = {name: value for name, (value,) in numbers.items()}
    made |= {name: str(text) for name, text in data.items() if name not in _WALLS and text}
    made |= {"scans": int(made["scans"]), "voxel_um": voxel and tuple(voxel)}
    return WallCalibration(**made)


def _pair(name: object, value: Any, path: Path) -> tuple[float, float]:
    flat = _flat(value)
    if flat is None or len(flat) != 2:
        raise ScanFileError(f"{path}: the interval of {name} is {value!r}, not two numbers")
    return flat[0], flat[1]


def _all_numbers(
    limits: dict[str, tuple[int, float, float]], data: dict[str, object], path: Path
) -> dict[str, list[float]]:
    """Return the numbers that are given, each as a flat list."""
    numbers = {}
    for name, (count, low, high) in limits.items():
        if data.get(name) is None:
            continue
        flat = _flat(data[name])
        if flat is None or len(flat) != count or not all(low <= value <= high for value in flat):
            raise ScanFileError(
                f"{path}: {name} is {data[name]!r}; it must be {count} number(s) in {low:g} to "
                f"{high:g}"
            )
        numbers[name] = flat
    return numbers


def _flat(value: Any) -> list[float] | None:
    """Finite numbers of nested lists; None where there is anything else."""
    if isinstance(value, list | tuple):
        parts = [_flat(item) for item in value]
        return None if None in parts else [number for part in parts for number in part or ()]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return [float(value)]


def _plain(value: Any) -> Any:
    """Tuples as lists, which YAML has."""
    turn: dict[type, Callable[[Any], Any]] = {
        dict: lambda v: {key: _plain(item) for key, item in v.items()},
        tuple: lambda v: [_plain(item) for item in v],
        list: lambda v: [_plain(item) for item in v],
    }
    return turn.get(type(value), lambda v: v)(value)
