"""Unpack an uploaded zip of scan slices: confined to its folder, limited in size.

A zip is believed in nothing: names are checked one by one, sizes are counted while they come.
"""

from __future__ import annotations

import re
import stat
import zipfile
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np
import tifffile

from printctl.system_errors import is_known
from printctl.web.errors import BadRequestError
from printctl.web.scan.unpacked_size import scan_limits
from printctl.web.security.archives import check_growth

MOST_FILES: Final = 20_000
MOST_DEPTH: Final = 6
_PIECE: Final = 1 << 20
_PART: Final = re.compile(r"[A-Za-z0-9._][A-Za-z0-9._ +-]{0,99}")
_SLICES: Final = (".tif", ".tiff")


def is_stack(path: Path) -> bool:
    """Whether a file is a zip of slices, and not a format that is a zip itself (.npz, .oct)."""
    if not zipfile.is_zipfile(path):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            names = [PurePosixPath(one.filename).name for one in archive.infolist()]
    except (zipfile.BadZipFile, NotImplementedError):
        return False
    return "Header.xml" not in names and not all(name.endswith(".npy") for name in names)


def unpack_stack(path: Path, folder: Path, most_bytes: int) -> Path:
    """Unpack DICOM slices or an OME-Zarr into a folder, or join TIFF slices in one file.

    Parameters
    ----------
    path : Path
        The zip.
    folder : Path
        New; the file of joined slices stands in it, too.
    most_bytes : int
        Of all that comes out.

    Returns
    -------
    Path
        What the readers read: the folder, one in it, or a file.

    Raises
    ------
    BadRequestError
        For a name that leads elsewhere, a link, too much, or a broken archive.
    """
    folder.mkdir(parents=True)
    try:
        with zipfile.ZipFile(path) as archive:
            _unpack(archive, folder, most_bytes)
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, OSError) as exc:
        if is_known(exc):
            raise
        raise BadRequestError(f"the archive can't be unpacked: {exc}") from exc
    top = folder
    while len(inside := sorted(top.iterdir())) == 1 and inside[0].is_dir():
        top = inside[0]
    if inside and all(one.suffix.lower() in _SLICES for one in inside):
        return _joined(inside, folder)
    return top


def _unpack(archive: zipfile.ZipFile, folder: Path, most_bytes: int) -> None:
    members = [one for one in archive.infolist() if not one.is_dir()]
    if len(members) > MOST_FILES:
        raise BadRequestError(f"the archive holds {len(members)} files; at most {MOST_FILES}")
    total = sum(one.file_size for one in members)
    if total > most_bytes:
        raise BadRequestError(
            f"the archive unpacks to {total / 1e6:.0f} MB; at most {most_bytes / 1e6:.0f} MB"
        )
    limits = scan_limits(most_bytes)
    check_growth(total, sum(one.compress_size for one in members), limits)
    left = most_bytes
    for member in members:
        left = _write(archive, member, folder / _place(member), left)


def _place(member: zipfile.ZipInfo) -> PurePosixPath:
    """Where a member goes, relative to the folder."""
    name, mode = member.filename, member.external_attr >> 16
    parts = name.split("/")
    bad = stat.S_ISLNK(mode) or name.startswith("/") or len(parts) > MOST_DEPTH
    if bad or any(not _PART.fullmatch(part) or part in (".", "..") for part in parts):
        raise BadRequestError(f"the archive names {name[:80]!r}, which isn't unpacked")
    return PurePosixPath(*parts)


def _write(archive: zipfile.ZipFile, member: zipfile.ZipInfo, place: Path, left: int) -> int:
    """Write a member; give what may still come."""
    place.parent.mkdir(parents=True, exist_ok=True)
    with archive.open(member) as source, place.open("xb") as out:
        while piece := source.read(_PIECE):
            left -= len(piece)
            if left < 0:
                raise BadRequestError("the archive holds more than it says; it isn't unpacked")
            out.write(piece)
    return left


def _joined(slices: list[Path], folder: Path) -> Path:
    """One stack of slices in the order of their names; numbers count as numbers."""
    ordered = sorted(slices, key=lambda one: [int(n) for n in re.findall(r"\d+", one.stem)] or [0])
    first = _slice(ordered[0])
    if len(ordered) < 2:
        raise BadRequestError("the archive holds one slice; a volume has more")
    out = folder.with_name(f"{folder.name}.joining.tif")
    volume = tifffile.memmap(out, shape=(len(ordered), *first.shape), dtype=first.dtype)
    for number, path in enumerate(ordered):
        image = _slice(path)
        if image.shape != first.shape or image.dtype != first.dtype:
            raise BadRequestError(
                f"slice {path.name} is {image.shape} {image.dtype}, the first is {first.shape} "
                f"{first.dtype}; slices of a volume are alike"
            )
        volume[number] = image
        path.unlink()
    volume.flush()
    place = folder / "volume.tif"
    return out.replace(place)


def _slice(path: Path) -> np.ndarray[tuple[int, ...], np.dtype[np.generic]]:
    try:
        image = tifffile.imread(path)
    except Exception as exc:
        # tifffile raises what its many parsers raise; whichever it is, the slice can't be read.
        raise BadRequestError(f"slice {path.name} can't be read: {exc}") from exc
    if image.ndim != 2:
        raise BadRequestError(f"slice {path.name} has {image.ndim} axes; a slice has 2")
    return np.asarray(image)
