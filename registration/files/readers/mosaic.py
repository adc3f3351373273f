"""Mosaic: fuse several scans of one sample (tiles, depth stacks, layers) into one volume.

A YAML file lists them::

    mosaic: tiles            # or depth, or layers
    settle_um: 200           # how far the overlap may move a scan from where it is said to lie
    scans:
      - {file: a.oct, at_mm: [0, 0, 0]}
      - {file: b.oct, at_mm: [5.8, 0, 0]}

`at_mm` is where voxel (0, 0, 0) of a scan lies, as x, y, z of the scan's frame (z geometric, down
where depth goes down), from the stage's own coordinates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from firmware_profiles.yaml_file import read_yaml
from kernels.arrays import FloatArray
from registration.errors import ScanFileError
from registration.files.readers.fuse import Kind, fuse
from registration.files.readers.metadata import ScanOverrides
from registration.files.readers.overlap import Placement, settle
from registration.files.readers.read import read_scan
from registration.scan import Scan

_SUFFIXES = (".yaml", ".yml")
_KINDS: tuple[Kind, ...] = ("tiles", "depth", "layers")
_KEYS = ("mosaic", "settle_um", "scans")
_MOST_SCANS = 1000
_MOST_BYTES = 1 << 20


@dataclass(frozen=True)
class _Listed:
    kind: Kind
    settle_mm: float
    files: tuple[Path, ...]
    at_mm: FloatArray


def is_mosaic(path: Path) -> bool:
    """Whether a path is a mosaic's list, by its name."""
    return path.suffix.lower() in _SUFFIXES


def read_mosaic(path: Path, overrides: ScanOverrides | None = None) -> Scan:
    """Read every scan of a list, find how they lie by their overlap, and fuse them.

    The notes say how far scans were moved and by how much pairs still disagree. The result has
    the first scan's voxels and is float32.

    Raises
    ------
    ScanFileError
        When the list or a scan can't be read, their voxels differ, or one overlaps no other.
    """
    listed = _parsed(path)
    scans = [read_scan(file, overrides) for file in listed.files]
    _check_alike(scans)
    voxel = np.array(scans[0].geometric_voxel_mm[::-1])
    placed = settle([scan.volume for scan in scans], listed.at_mm / voxel, listed.settle_mm / voxel)
    if placed.alone:
        raise ScanFileError(
            f"{path}: {listed.files[placed.alone[0]].name} overlaps none of the others; check "
            "at_mm (mm, x, y, z)"
        )
    volume = fuse([scan.volume for scan in scans], placed.at, listed.kind, path)
    return replace(
        scans[0],
        volume=volume,
        came_from=path,
        space=None,
        notes=(*scans[0].notes, _note(placed, voxel, len(scans), listed.kind)),
    )


def listed_files(path: Path) -> tuple[Path, ...]:
    """The scans that a list names.

    Raises
    ------
    ScanFileError
        When the list can't be read.
    """
    return _parsed(path).files


def _note(placed: Placement, voxel: FloatArray, count: int, kind: str) -> str:
    """What the overlaps have shown, for people."""
    text = f"{count} scans fused ({kind}), {len(placed.left)} overlaps"
    if len(placed.left):
        left = 1e3 * np.linalg.norm(placed.left * voxel, axis=1)
        moved = 1e3 * np.linalg.norm(placed.moved * voxel, axis=1)
        text += (
            f"; moved by up to {moved.max():.0f} µm, pairs then disagree by "
            f"{math.sqrt(float(np.mean(left**2))):.1f} µm (RMS), {left.max():.1f} at most"
        )
    if placed.blind:
        text += f"; {placed.blind} overlaps show too little to tell and were left as listed"
    return text


def _parsed(path: Path) -> _Listed:
    if not path.is_file() or path.stat().st_size > _MOST_BYTES:
        raise ScanFileError(f"{path}: no list of scans there; check the path")
    try:
        data = read_yaml(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise ScanFileError(f"{path}: not YAML ({exc}); mend it") from exc
    if not isinstance(data, dict) or set(data) - set(_KEYS) or data.get("mosaic") not in _KINDS:
        raise ScanFileError(
            f"{path}: isn't a mosaic's list; it has the keys {', '.join(_KEYS)}, and mosaic is one "
            f"of {', '.join(_KINDS)}"
        )
    scans, settle_um = data.get("scans"), data.get("settle_um", 200)
    if not isinstance(scans, list) or not 2 <= len(scans) <= _MOST_SCANS:
        raise ScanFileError(f"{path}: scans must list 2 to {_MOST_SCANS} scans")
    if not _finite(settle_um) or not 0 <= settle_um <= 5000:
        raise ScanFileError(f"{path}: settle_um is {settle_um!r}; it must lie in 0 to 5000")
    entries = [_entry(item, path) for item in scans]
    places = np.array([at for _, at in entries], dtype=np.float64)
    return _Listed(data["mosaic"], settle_um * 1e-3, tuple(f for f, _ in entries), places)


def _entry(item: Any, path: Path) -> tuple[Path, list[float]]:
    good = isinstance(item, dict) and set(item) == {"file", "at_mm"}
    at = item["at_mm"] if good else None
    if not (good and isinstance(item["file"], str) and isinstance(at, list) and len(at) == 3):
        raise ScanFileError(f"{path}: {item!r} isn't {{file: NAME, at_mm: [x, y, z]}}")
    if not all(_finite(value) and abs(value) <= 1000 for value in at):
        raise ScanFileError(f"{path}: at_mm {at!r} must be three numbers within ± 1000 mm")
    return path.parent / item["file"], [float(value) for value in at]


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _check_alike(scans: list[Scan]) -> None:
    first = scans[0]
    for scan in scans[1:]:
        same = (scan.scale, scan.modality, scan.depth_down, scan.optical_depth) == (
            first.scale, first.modality, first.depth_down, first.optical_depth
        )  # fmt: skip
        if not same or not np.allclose(
            [*scan.voxel_mm, scan.refractive_index], [*first.voxel_mm, first.refractive_index], 1e-3
        ):
            raise ScanFileError(
                f"{scan.came_from}: its voxels of {scan.voxel_mm} mm ({scan.scale}, index "
                f"{scan.refractive_index:g}) aren't those of {first.came_from.name}: "
                f"{first.voxel_mm} mm ({first.scale}, index {first.refractive_index:g}); scan all "
                "parts alike"
            )
