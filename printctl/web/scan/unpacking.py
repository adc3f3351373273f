"""Unpack an uploaded zip of scan slices: confined to its folder, limited in size.

A zip is believed in nothing: names are checked one by one, sizes are counted while they come.
"""

from __future__ import annotations

import re
import stat
import zipfile
from pathlib import Path, PurePosixPath
from typing import Final

from printctl.system_errors import is_known
from printctl.web.errors import BadRequestError
from printctl.web.scan.unpacked_size import check_growth
from registration.errors import ScanFileError
from registration.files.readers.tiff import has_slices, read_tiff_folder

MOST_FILES: Final = 20_000
MOST_DEPTH: Final = 6
_PIECE: Final = 1 << 20
_PART: Final = re.compile(r"[A-Za-z0-9._][A-Za-z0-9._ +-]{0,99}")


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
    """Unpack DICOM or TIFF slices or an OME-Zarr into a folder.

    Parameters
    ----------
    path : Path
        The zip.
    folder : Path
        New.
    most_bytes : int
        Of all that comes out.

    Returns
    -------
    Path
        What the readers read: the folder, or one in it.

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
    if has_slices(top):
        try:
            read_tiff_folder(top)
        except ScanFileError as exc:
            raise BadRequestError(str(exc).replace(f"{top}: ", "")) from exc
    return top


def _unpack(archive: zipfile.ZipFile, folder: Path, most_bytes: int) -> None:
    members = [one for one in archive.infolist() if not one.is_dir()]
    if len(members) > MOST_FILES:
        raise BadRequestError(f"the archive holds {len(members)} files; at most {MOST_FILES}")
    total = sum(one.file_size for one in members)
    check_growth(total, sum(one.compress_size for one in members), most_bytes)
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
