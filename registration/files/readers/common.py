"""Shared parts of the scan readers: raw result, limits, units, space, storage, archives."""

from __future__ import annotations

import errno
import importlib
import math
import re
import struct
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kernels.arrays import FloatArray
from registration.errors import RegistrationError, ScanFileError
from registration.scan import Space, drop_pages


@contextmanager
def scan_file_errors(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a library trips over into a `ScanFileError` that names file and format.

    What the disk or the memory fails with goes through: the file isn't to blame. Libraries
    raise OSError for broken content too, without a number, and the system itself does (EINVAL)
    when broken content makes one seek before a file's beginning.

    Raises
    ------
    ScanFileError
        When reading failed for another reason.
    """
    try:
        yield
    except (RegistrationError, MemoryError):
        raise
    except Exception as exc:
        if isinstance(exc, OSError) and exc.errno not in (None, errno.EINVAL):
            raise
        raise ScanFileError(f"{path}: broken {kind} ({exc}); copy or export it again") from exc


def import_extra(module: str, path: Path) -> Any:
    """A module that only some formats need.

    Parameters
    ----------
    module : str
    path : Path
        The file that needs it.

    Raises
    ------
    ScanFileError
        When it isn't installed; the message names the extra.
    """
    try:
        return importlib.import_module(module)
    except ImportError as exc:
        raise ScanFileError(
            f"{path}: needs {module}, which isn't installed; run: pip install 'printctl[scans]'"
        ) from exc


EXTRA_OF: Final = {".h5": "h5py", ".hdf5": "h5py", ".dcm": "pydicom", ".zarr": "zarr"}
"""Module that reads a format, by the name's ending."""


def check_extra(path: Path) -> None:
    """Raise `ScanFileError` if a file's name says that an extra must read it, which isn't there."""
    if (module := EXTRA_OF.get(path.suffix.lower())) is not None:
        import_extra(module, path)


_MM = {
    "m": 1e3, "meter": 1e3, "metre": 1e3, "cm": 10.0, "centimeter": 10.0, "centimetre": 10.0,
    "mm": 1.0, "millimeter": 1.0, "millimetre": 1.0,
    "um": 1e-3, "micron": 1e-3, "micrometer": 1e-3, "micrometre": 1e-3,
    "nm": 1e-6, "nanometer": 1e-6, "nanometre": 1e-6, "å": 1e-7, "angstrom": 1e-7,
    "in": 25.4, "inch": 25.4,
}  # fmt: skip
_NO_UNIT = ("", "pixel", "px", "none", "voxel", "unknown")


def millimetres(unit: str | None) -> float | None:
    """Return a unit's length in mm; None where it isn't a length that is known."""
    plain = _plain(unit)
    return _MM.get(plain, _MM.get(plain.removesuffix("s")))


def _plain(unit: str | None) -> str:
    """A unit in small letters, µ as u: it has two code points, and ImageJ writes it escaped."""
    plain = (unit or "").strip().strip('\x00"').lower()
    return re.sub(r"µ|μ|\\u00b5", "u", plain)


def known_voxel(
    sizes: Sequence[Any], units: Sequence[str | None]
) -> tuple[dict[str, list[float]], tuple[str, ...]]:
    """Return what a file says of its voxel size, and why none of it is used.

    A unit that isn't known is no error: the user may state the size.

    Parameters
    ----------
    sizes : three of number, numeral or None
        Along z, y, x.
    units : three of str or None
        Of each size.

    Returns
    -------
    known : dict
        ``voxel_mm``, or nothing.
    notes : tuple of str
        Units that aren't known.
    """
    each = [millimetres(unit) for unit in units]
    if all(sizes) and all(each):
        scaled = [float(size) * (mm or 0.0) for size, mm in zip(sizes, each, strict=True)]
        return {"voxel_mm": scaled}, ()
    strange = [u for u, mm in zip(units, each, strict=True) if not mm and _plain(u) not in _NO_UNIT]
    told = " and ".join(dict.fromkeys(map(repr, strange)))
    return {}, (f"its unit of length {told} isn't known, so its voxel size isn't used",) * bool(
        told
    )


MOST_XML_BYTES = 64 << 20
"""No header is longer."""


def parse_xml(text: bytes | str, source: str | Path) -> ElementTree.Element:
    """The root of an XML header.

    Raises
    ------
    ScanFileError
        When it isn't XML, is far too long, or declares entities (which can grow without end).
    """
    data = text.encode() if isinstance(text, str) else text
    if len(data) > MOST_XML_BYTES:
        raise ScanFileError(f"{source}: its XML header has {len(data)} bytes; export it again")
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ScanFileError(f"{source}: its XML header declares entities; no scanner writes them")
    try:
        return ElementTree.fromstring(data)
    except ElementTree.ParseError as exc:
        raise ScanFileError(f"{source}: broken XML header ({exc}); export it again") from exc


MOST_BYTES = 1 << 40
"""No scan holds more: 1 TiB."""
DEFLATE_RATIO = 1032
"""Deflate can't expand a byte to more (RFC 1951: a match of 258 bytes takes at least 2 bits)."""
ANY_RATIO = 8 * DEFLATE_RATIO
"""Other compressions have no such bound, but no scan that shows anything shrinks by more."""
IN_MEMORY_BYTES = 64 << 20
"""A volume up to this is read into memory; a larger one stays a view of a file."""


def bytes_of(shape: Sequence[int], dtype: np.dtype[np.generic], path: Path) -> int:
    """Bytes that an array of this shape takes.

    Raises
    ------
    ScanFileError
        When a size isn't positive, or the whole is beyond any scan.
    """
    if any(size < 1 for size in shape):
        raise ScanFileError(f"{path}: its header says {_times(shape)} voxels; export it again")
    total = math.prod(int(size) for size in shape) * dtype.itemsize
    if total > MOST_BYTES:
        raise ScanFileError(
            f"{path}: its header says {_times(shape)} voxels of {dtype}, {total:.3g} bytes; no "
            f"scan is larger than {MOST_BYTES:.3g}: the header is broken, export it again"
        )
    return total


def check_available(
    shape: Sequence[int], dtype: np.dtype[np.generic], available: int, path: Path
) -> None:
    """Refuse an array that its file can't hold.

    Parameters
    ----------
    shape, dtype
        As the header says.
    available : int
        Bytes that the file can give for it.
    path : Path
        For the message.

    Raises
    ------
    ScanFileError
        When the header promises more than there is.
    """
    needed = bytes_of(shape, dtype, path)
    if needed > available:
        raise ScanFileError(
            f"{path}: its header says {_times(shape)} voxels of {dtype}, {needed} bytes, but the "
            f"file holds at most {available}; it is truncated or its sizes are wrong: copy or "
            "export it again"
        )


def _times(shape: Sequence[int]) -> str:
    return " × ".join(str(size) for size in shape)


LPS = "LPS"
_MOST_SKEW_DEGREES = 0.1
"""Axes that are square to this are kept: less than 2 µm at 1 mm."""


@dataclass(frozen=True)
class FileSpace:
    """How a file's axes run in a right-handed space.

    Attributes
    ----------
    name : str
        Of the space (`Space.name`).
    directions : (3, 3) float64
        Rows: unit vectors along the array's axes 0, 1, 2, in space.
    origin : (3,) float64, mm
        Centre of voxel (0, 0, 0).
    """

    name: str
    directions: FloatArray
    origin: FloatArray

    def is_right_handed(self, axes: str) -> bool:
        """Whether x, y, z, as `axes` names the array's axes, make a right-handed frame."""
        return float(np.linalg.det(self._by_name(axes))) > 0

    def of_scan(self, axes: str, reversed_mm: float | None) -> Space:
        """The scan's frame in the space.

        Parameters
        ----------
        axes : str
            Names of the array's axes, slowest first.
        reversed_mm : float or None, mm
            From the first to the last voxel along y where y was reversed.
        """
        rows, origin = self._by_name(axes), self.origin
        if reversed_mm is not None:
            origin = origin + reversed_mm * rows[1]
            rows = rows * np.array([[1.0], [-1.0], [1.0]])
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rows.T, origin
        return Space(self.name, matrix)

    def _by_name(self, axes: str) -> FloatArray:
        """Rows along x, y, z."""
        return self.directions[[axes.lower().index(name) for name in "xyz"]]


def file_space(name: str, steps: ArrayLike, origin: ArrayLike, path: Path) -> FileSpace:
    """A file's axes in space, from a step along each (rows: array axes 0, 1, 2; any length).

    Raises
    ------
    ScanFileError
        When a step has no direction, or the axes aren't square to each other: such a volume can't
        be kept as a box of voxels.
    """
    rows = np.asarray(steps, dtype=np.float64).reshape(3, 3)
    start = np.asarray(origin, dtype=np.float64).reshape(3)
    lengths = np.linalg.norm(rows, axis=1)
    if not (np.isfinite(rows).all() and np.isfinite(start).all() and lengths.min() > 0):
        raise ScanFileError(
            f"{path}: its header gives an axis the direction {_worst(rows, lengths)}; write it "
            "again with a direction for each axis, or without orientation"
        )
    units = rows / lengths[:, None]
    for first, second in ((0, 1), (0, 2), (1, 2)):
        cosine = float(np.clip(units[first] @ units[second], -1, 1))
        angle = float(np.degrees(np.arccos(cosine)))
        if abs(angle - 90) > _MOST_SKEW_DEGREES:
            raise ScanFileError(
                f"{path}: array axes {first} and {second} meet at {angle:.2f}° (needed: 90 ± "
                f"{_MOST_SKEW_DEGREES:g}°), a sheared volume (a tilted gantry?); resample it to "
                "a straight grid in the program that wrote it"
            )
    return FileSpace(name, units, start)


def _worst(rows: FloatArray, lengths: FloatArray) -> list[float]:
    bad = int(np.argmin(np.where(np.isfinite(lengths), lengths, -1)))
    return [float(value) for value in rows[bad]]


Array = NDArray[np.generic]


@dataclass(frozen=True)
class FileVolume:
    """A volume as it lies in its file, and what the file says of it.

    Attributes
    ----------
    volume : array of three axes, any strides
        A view of the file where that is possible, so that nothing is read twice.
    known : mapping
        What the file says, by the names of `ScanOverrides` (``axes`` included).
    space : FileSpace or None
        How the array's axes run in space; None where the file doesn't say.
    notes : tuple of str
        What the user should know of this reading.
    """

    volume: Array
    known: Mapping[str, Any] = field(default_factory=dict)
    space: FileSpace | None = None
    notes: tuple[str, ...] = ()


_COPY_BYTES = 1 << 20
"""Turned at a time where axes change places: what a core's cache holds."""
_DROP_BYTES = 64 << 20


def mapped(path: Path, dtype: np.dtype[np.generic], offset: int, shape: Sequence[int]) -> Array:
    """A view of an array in a file, in C order; writes go to memory and never to the file.

    Raises
    ------
    ScanFileError
        When the file is shorter than the array.
    """
    check_available(shape, dtype, path.stat().st_size - offset, path)
    return np.memmap(path, dtype, "c", offset, tuple(shape))


def empty(shape: Sequence[int], dtype: np.dtype[np.generic], path: Path) -> Array:
    """Room for a volume that is decoded: memory, or a nameless temporary file when it is large.

    Raises
    ------
    ScanFileError
        When the size is beyond any scan.
    OSError
        When the disk has no room for it.
    """
    total = bytes_of(shape, dtype, path)
    if total <= IN_MEMORY_BYTES:
        return np.empty(tuple(shape), dtype)
    with tempfile.TemporaryFile() as room:
        room.truncate(total)
        return np.memmap(room, dtype, "r+", 0, tuple(shape))


def fill_volume(
    slices: Iterable[Array], shape: Sequence[int], dtype: np.dtype[np.generic], path: Path
) -> Array:
    """A volume from its slices along the first axis, in order."""
    out = empty(shape, dtype, path)
    for index, part in enumerate(slices):
        out[index] = part
    return out


def native(volume: Array) -> Array:
    """Contiguous, in the machine's byte order, and no float16: what the kernels take.

    A volume too large for memory stays the view it is, unless its numbers need turning; `slabs`
    of the scan then make the parts contiguous.
    """
    kind = np.dtype(np.float32) if volume.dtype == np.float16 else volume.dtype.newbyteorder("=")
    if volume.nbytes > IN_MEMORY_BYTES and volume.dtype != np.float16:
        return volume
    if volume.flags.c_contiguous and volume.dtype == kind and not isinstance(volume, np.memmap):
        return volume
    out = np.empty(volume.shape, kind)
    axis = int(np.argmax(np.abs(volume.strides)))
    count = max(1, _COPY_BYTES * volume.shape[axis] // max(1, volume.nbytes))
    for first in range(0, volume.shape[axis], count):
        part = [slice(None)] * 3
        part[axis] = slice(first, first + count)
        out[tuple(part)] = volume[tuple(part)]
        if first // count % max(1, _DROP_BYTES // _COPY_BYTES) == 0:
            drop_pages(volume)
    drop_pages(volume)
    return out


_PIECE = 16 << 20
_LOCAL_HEADER = 30


def available_bytes(info: zipfile.ZipInfo) -> int:
    """Bytes that a member can really give, whatever its header claims."""
    if info.compress_type == zipfile.ZIP_STORED:
        return min(info.file_size, info.compress_size)
    return min(info.file_size, info.compress_size * DEFLATE_RATIO)


def read_into(handle: IO[bytes], out: Array) -> None:
    """Fill a contiguous array from a stream, piece by piece.

    Raises
    ------
    EOFError
        When the stream ends early.
    """
    room = memoryview(out.reshape(-1).view(np.uint8))  # type: ignore[arg-type]
    done = 0
    while done < len(room):
        piece = handle.read(min(_PIECE, len(room) - done))
        if not piece:
            raise EOFError(f"ends after {done} of {len(room)} bytes")
        room[done : done + len(piece)] = piece
        done += len(piece)


def member_array(
    archive: zipfile.ZipFile,
    info: zipfile.ZipInfo,
    dtype: np.dtype[np.generic],
    shape: tuple[int, ...],
    path: Path,
) -> Array:
    """An array that is a member's whole content: a view of the file where it lies uncompressed.

    Raises
    ------
    ScanFileError
        When the member is too short for it.
    """
    check_available(shape, dtype, available_bytes(info), path)
    if info.compress_type == zipfile.ZIP_STORED and not info.flag_bits & 0x1:
        return mapped(path, dtype, _data_offset(path, info), shape)
    out = empty(shape, dtype, path)
    with archive.open(info) as handle:
        read_into(handle, out)
    return out


def _data_offset(path: Path, info: zipfile.ZipInfo) -> int:
    """Where a member's bytes begin (its local header's names may differ in length)."""
    with path.open("rb") as handle:
        handle.seek(info.header_offset)
        local = handle.read(_LOCAL_HEADER)
    if len(local) < _LOCAL_HEADER or local[:4] != b"PK\x03\x04":
        raise zipfile.BadZipFile(f"no member begins at byte {info.header_offset}")
    name, extra = struct.unpack("<HH", local[26:30])
    return info.header_offset + _LOCAL_HEADER + name + extra
