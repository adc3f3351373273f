"""Unpack an untrusted zip file into a folder of its own.

Refused are absolute names, ``..``, links, devices, encryption, names twice, too many files, too
much in all, and what shrinks so well that it can only be meant to fill the disk. Sizes are counted
as they come out: what the archive says of itself isn't believed.
"""

from __future__ import annotations

import secrets
import shutil
import stat
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

from printctl.system_errors import is_known
from printctl.web.errors import BadRequestError, ConflictError

_PIECE: Final = 1 << 20
_LONGEST_NAME: Final = 200
_FORBIDDEN: Final = frozenset('\\:*?"<>|')


@dataclass(frozen=True)
class ArchiveLimits:
    """Size limits of an unpacked archive.

    Attributes
    ----------
    files : int
    bytes : int
        Of all files together.
    ratio : float
        Bytes out for a byte in.
    ratio_from : int
        Bytes out from which the ratio counts.
    """

    files: int = 10_000
    bytes: int = 8_000_000_000
    ratio: float = 200.0
    ratio_from: int = 10_000_000


def extract_archive(archive: Path, folder: Path, limits: ArchiveLimits | None = None) -> list[Path]:
    """Unpack ``archive`` as the new ``folder``; it is there whole, or not at all.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    BadRequestError
        For an archive that can't be read, or that isn't taken.
    ConflictError
        When there is such a folder.
    """
    limits = limits or ArchiveLimits()
    if folder.exists():
        raise ConflictError(f"there is a folder {folder.name} already; choose another name")
    part = folder.with_name(f".{secrets.token_hex(8)}.part")
    part.mkdir(parents=True)
    try:
        with zipfile.ZipFile(archive) as opened:
            names = _extract(opened, part, limits, archive.stat().st_size)
        part.rename(folder)
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, EOFError, OSError) as exc:
        if is_known(exc):
            raise
        raise BadRequestError(f"{archive.name} can't be unpacked: {exc}") from exc
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return [folder / name for name in names]


def _extract(
    opened: zipfile.ZipFile, folder: Path, limits: ArchiveLimits, packed: int
) -> list[PurePosixPath]:
    entries = opened.infolist()
    if len(entries) > limits.files:
        raise BadRequestError(f"the archive has {len(entries)} files; at most {limits.files}")
    names: list[PurePosixPath] = []
    total = 0
    for entry in entries:
        name = inside(entry)
        if entry.is_dir():
            (folder / name).mkdir(parents=True, exist_ok=True)
            continue
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        with opened.open(entry) as source, (folder / name).open("xb") as file:
            while piece := source.read(_PIECE):
                total += len(piece)
                check_growth(total, packed, limits)
                file.write(piece)
        names.append(name)
    return names


def inside(entry: zipfile.ZipInfo) -> PurePosixPath:
    """The entry's name, if it stays inside.

    Raises
    ------
    BadRequestError
    """
    name = entry.filename
    path = PurePosixPath(name)
    kind = stat.S_IFMT(entry.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        raise BadRequestError(f"{name[:80]!r} in the archive is a link or a device, not a file")
    if entry.flag_bits & 1:
        raise BadRequestError(f"{name[:80]!r} in the archive is encrypted")
    bad = path.is_absolute() or not path.parts or len(name) > _LONGEST_NAME
    bad = bad or not name.isprintable() or bool(_FORBIDDEN & set(name))
    if bad or any(part in ("..", ".") or part.startswith(".") for part in path.parts):
        raise BadRequestError(
            f"{name[:80]!r} in the archive isn't a plain name: no '..', no hidden or absolute names"
        )
    return path


def check_growth(total: int, packed: int, limits: ArchiveLimits) -> None:
    """Refuse an archive that has given ``total`` bytes out of ``packed``, if that is too much.

    Raises
    ------
    BadRequestError
    """
    if total > limits.bytes:
        raise BadRequestError(
            f"the archive unpacks to more than {total / 1e6:.0f} MB; at most "
            f"{limits.bytes / 1e6:g} MB are taken"
        )
    if total > limits.ratio_from and total > limits.ratio * packed:
        raise BadRequestError(
            f"the archive unpacks to more than {limits.ratio:g} times its size; pack it anew "
            "without emptiness, or send the files alone"
        )
