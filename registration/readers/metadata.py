"""What a scan must say of itself, gathered from its file, its sidecar and the user."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from registration.errors import ScanFileError
from registration.scan import Scan

SCHEMA = "printctl-scan-1"

_CHOICES = {"scale": ("linear", "db"), "modality": ("oct", "microct", "confocal")}
_LONGEST_VOXEL_MM = 5.0


@dataclass(frozen=True)
class ScanOverrides:
    """What the user says of a scan; takes precedence over the file. None: as the file says.

    Attributes
    ----------
    voxel_mm : (dz, dy, dx) or None, mm
        Voxel size; dz optical where `optical_depth`.
    refractive_index : float or None
        Group index.
    optical_depth : bool or None
        Whether dz counts optical path.
    scale : "linear" or "db" or None
        Of the intensity.
    modality : "oct" or "microct" or "confocal" or None
        What measured.
    depth_down : bool or None
        Whether growing depth index goes down into the sample.
    """

    voxel_mm: tuple[float, float, float] | None = None
    refractive_index: float | None = None
    optical_depth: bool | None = None
    scale: Literal["linear", "db"] | None = None
    modality: Literal["oct", "microct", "confocal"] | None = None
    depth_down: bool | None = None


NAMES = tuple(item.name for item in fields(ScanOverrides))


def describe(scan: Scan) -> str:
    """The scan's metadata as ASCII JSON."""
    plain = {name: getattr(scan, name) for name in NAMES}
    return json.dumps({"schema": SCHEMA, **plain}, sort_keys=True)


def parse(text: str, source: str) -> dict[str, Any]:
    """Metadata in a JSON text; unknown keys are refused.

    Raises
    ------
    ScanFileError
        When the text isn't a JSON object, or holds a key that isn't known.
    """
    try:
        found = json.loads(text)
    except ValueError as exc:
        raise ScanFileError(f"{source}: not JSON ({exc}); mend or remove it") from exc
    if not isinstance(found, dict):
        raise ScanFileError(f"{source}: holds no JSON object; give keys {', '.join(NAMES)}")
    found.pop("schema", None)
    unknown = sorted(set(found) - set(NAMES))
    if unknown:
        raise ScanFileError(f"{source}: unknown key {unknown[0]}; known are {', '.join(NAMES)}")
    return found


def sidecar(path: Path) -> dict[str, Any]:
    """Metadata in ``NAME.json`` beside the scan, if there is one."""
    beside = path.with_suffix(".json")
    if not beside.is_file():
        return {}
    return parse(beside.read_text(encoding="utf-8"), str(beside))


def build_scan(
    volume: NDArray[np.generic], found: Mapping[str, Any], overrides: ScanOverrides, path: Path
) -> Scan:
    """Check and join what is known of a scan.

    Raises
    ------
    ScanFileError
        When something needed is missing or impossible, naming the option that gives it.
    """
    said = {name: value for name, value in asdict(overrides).items() if value is not None}
    known = {**found, **said}
    known.setdefault("depth_down", known.get("modality") == "oct" or None)
    if known.get("modality") != "oct":
        # Only light has an optical path of another length.
        known = {"refractive_index": 1.0, "optical_depth": False, "depth_down": False} | {
            name: value for name, value in known.items() if value is not None
        }
    missing = [name for name in NAMES if known.get(name) is None]
    if missing:
        options = ", ".join("--" + name.replace("_", "-") for name in missing)
        raise ScanFileError(f"{path}: doesn't say {', '.join(missing)}; give {options}")
    _check_volume(volume, path)
    _check_choices(known, path)
    return Scan(
        volume=_native(volume),
        voxel_mm=_voxel(known["voxel_mm"], path),
        refractive_index=_index(known["refractive_index"], path),
        optical_depth=bool(known["optical_depth"]),
        scale=known["scale"],
        modality=known["modality"],
        depth_down=bool(known["depth_down"]),
        came_from=path,
    )


def _check_volume(volume: NDArray[np.generic], path: Path) -> None:
    if volume.ndim != 3:
        raise ScanFileError(
            f"{path}: holds an array of shape {volume.shape}, not a stack of grey images; "
            "export one channel and one time point"
        )
    if volume.dtype.kind not in "uif":
        raise ScanFileError(f"{path}: grey values of type {volume.dtype} aren't real numbers")


def _native(volume: NDArray[np.generic]) -> NDArray[np.generic]:
    """Contiguous, in the machine's byte order, and no float16: what the kernels take."""
    kind = np.dtype(np.float32) if volume.dtype == np.float16 else volume.dtype.newbyteorder("=")
    return np.ascontiguousarray(volume, dtype=kind)


def _check_choices(known: Mapping[str, Any], path: Path) -> None:
    for name, allowed in _CHOICES.items():
        if known[name] not in allowed:
            raise ScanFileError(f"{path}: {name} is {known[name]!r}; known are {allowed}")
    for name in ("optical_depth", "depth_down"):
        if not isinstance(known[name], bool):
            raise ScanFileError(f"{path}: {name} is {known[name]!r}; it must be true or false")


def _voxel(value: Any, path: Path) -> tuple[float, float, float]:
    sizes = value if isinstance(value, list | tuple) else [value]
    good = len(sizes) == 3 and all(
        isinstance(size, int | float) and math.isfinite(size) and 0 < size <= _LONGEST_VOXEL_MM
        for size in sizes
    )
    if not good:
        raise ScanFileError(
            f"{path}: voxel_mm is {value!r}; it must be three sizes dz, dy, dx in mm above 0 and "
            f"at most {_LONGEST_VOXEL_MM:g}; give --voxel-mm"
        )
    return (float(sizes[0]), float(sizes[1]), float(sizes[2]))


def _index(value: Any, path: Path) -> float:
    if not (isinstance(value, int | float) and 1.0 <= value <= 2.0):
        raise ScanFileError(
            f"{path}: refractive_index is {value!r}; it must lie in 1 to 2 (hydrogels near 1.34); "
            "give --refractive-index"
        )
    return float(value)
