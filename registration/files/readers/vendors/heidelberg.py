"""Read the B-scan volume, voxel size and scan position from a Heidelberg Spectralis ``.vol``.

Offsets and meanings as in FabianRathke/octSegmentation (``HDEVolImporter.m``) and MedVisBonn/eyepy
(``he_vol``), which agree: 2048 bytes of header, SizeXSlo × SizeYSlo bytes of picture, then for each
B-scan ``BScanHdrSize`` bytes of header and SizeZ × SizeX float32, rows by depth. Lengths in mm,
values linear (programs show their fourth root), the largest float marks a place outside.

Not verified on a device's file: that the picture's y runs down (for the handedness). The header
gives no index and doesn't say what depth was divided by: asked for.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import ScanFileError
from registration.files.readers.common import (
    Array,
    FileSpace,
    FileVolume,
    check_available,
    fill_volume,
)

MAGIC = b"HSF-OCT-"
_SCAN_MARK = b"HSF-BS-"

_HEADER_BYTES = 2048
_OUTSIDE = 1e30
_LEAST_SINE = 0.1
_PICTURE = "fundus picture (x right, y down, z away)"
_VOLUMES = (0, 3, 4)
"""Scan patterns that are stacks of parallel B-scans: unknown, volume, fast volume."""


@dataclass(frozen=True)
class _Header:
    columns: int
    scans: int
    depth: int
    voxel_mm: tuple[float, float, float]
    first: int
    own: int
    pattern: int

    @property
    def stride(self) -> int:
        """Bytes from one B-scan to the next."""
        return self.own + 4 * self.columns * self.depth


def read_heidelberg(path: Path) -> FileVolume:
    """The volume of parallel B-scans.

    Raises
    ------
    ScanFileError
        When the file is truncated, its sizes are wrong, or it is a circle or a star.
    """
    data = np.memmap(path, np.uint8, "r")
    if len(data) < _HEADER_BYTES:
        raise ScanFileError(f"{path}: ends within its header; copy it again")
    header = _header(bytes(data[:_HEADER_BYTES]))
    if header.pattern not in _VOLUMES or header.scans < 2:
        raise ScanFileError(
            f"{path}: scan pattern {header.pattern} with {header.scans} B-scans isn't a volume; "
            "scan a volume"
        )
    shape, kind = (header.scans, header.depth, header.columns), np.dtype("<f4")
    room = (header.scans, header.stride)
    check_available(room, np.dtype(np.uint8), len(data) - header.first, path)
    _check_scans(data, header, path)
    outside = [0]
    volume = fill_volume(_scans(data, header, outside), shape, kind, path)
    known: dict[str, object] = {
        "axes": "yzx", "scale": "linear", "modality": "oct", "depth_down": True,
        "voxel_mm": header.voxel_mm,
    }  # fmt: skip
    notes: tuple[str, ...] = ()
    if outside[0]:
        notes = (f"{outside[0]} voxels outside the picture were set to 0",)
    return FileVolume(volume, known, _space(data, header), notes)


def _header(start: bytes) -> _Header:
    columns, scans, depth = struct.unpack_from("<3I", start, 12)
    dx, dy, dz = struct.unpack_from("<3d", start, 24)
    across, down = struct.unpack_from("<2I", start, 48)
    pattern, own = struct.unpack_from("<iI", start, 96)
    return _Header(columns, scans, depth, (dz, dy, dx), _HEADER_BYTES + across * down, own, pattern)


def _check_scans(data: Array, header: _Header, path: Path) -> None:
    """Hold the sizes in the header against the B-scans' own headers: versions differ in them."""
    for index in range(header.scans):
        at = header.first + index * header.stride
        mark = bytes(data[at : at + len(_SCAN_MARK)])
        (own,) = struct.unpack("<I", bytes(data[at + 12 : at + 16]))
        if mark != _SCAN_MARK or own != header.own:
            raise ScanFileError(
                f"{path}: B-scan {index + 1} of {header.scans} isn't where the header says "
                f"(begins with {mark!r}, a header of {own} bytes, not {header.own}), version "
                f"{bytes(data[:11]).decode('ascii', 'replace')}; export it again as .vol (raw)"
            )


def _scans(data: Array, header: _Header, outside: list[int]) -> Any:
    """The B-scans, places outside the picture set to 0 and counted."""
    for index in range(header.scans):
        begin = header.first + index * header.stride + header.own
        end = begin + 4 * header.columns * header.depth
        scan = np.array(data[begin:end]).view("<f4").reshape(header.depth, header.columns)
        empty = scan > _OUTSIDE
        outside[0] += int(empty.sum())
        scan[empty] = 0
        yield scan


def _space(data: Array, header: _Header) -> FileSpace | None:
    """From where the first and last B-scan lie in the picture: x right, y down, depth away.

    None where the places don't tell. B-scans are placed by an eye tracker, so that they stack
    nearly, not exactly, square to themselves: the part along them is left out.
    """
    ends = []
    for index in (0, header.scans - 1):
        at = header.first + index * header.stride
        ends.append(struct.unpack_from("<4d", bytes(data[at : at + 256]), 16))
    (x0, y0, x1, y1), (later_x, later_y, _, _) = ends
    along, across = np.array([x1 - x0, y1 - y0, 0.0]), np.array([later_x - x0, later_y - y0, 0.0])
    lengths = float(np.linalg.norm(along)), float(np.linalg.norm(across))
    turn = along[0] * across[1] - along[1] * across[0]
    if not np.isfinite(turn) or abs(turn) < _LEAST_SINE * lengths[0] * lengths[1] or turn == 0:
        return None
    unit = along / lengths[0]
    square = np.sign(turn) * np.array([-unit[1], unit[0], 0.0])
    return FileSpace(_PICTURE, np.array([square, [0.0, 0.0, 1.0], unit]), np.array([x0, y0, 0.0]))
