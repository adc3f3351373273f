"""Scans of the workspace: take in uploads, unpack archives within limits."""

from __future__ import annotations

import contextlib
import gzip
import json
import re
import secrets
import shutil
import stat
import tempfile
import zipfile
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path, PurePath, PurePosixPath
from typing import IO, Any, BinaryIO, ClassVar, Final

from pydantic import ConfigDict, TypeAdapter
from yaml import YAMLError

from design.files import write_text
from firmware_profiles.yaml_file import read_yaml
from printctl.system_errors import is_known
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.security.uploads import save_upload
from printctl.web.workspace import Workspace, checked_name, is_name, usable_name
from registration.errors import ScanFileError
from registration.files.readers import ScanOverrides
from registration.files.readers.metadata import NAMES, find_sidecar
from registration.files.readers.read import recognise
from registration.files.readers.volumes.tiff import has_slices, read_tiff_folder

# What a gzip stream gives is counted as it comes out; of a zip its own sizes count, which Python's
# reader never exceeds.
_PIECE: Final = 1 << 20
_RATIO: Final = 200
"""Most bytes out for a byte in, from `_RATIO_FROM` bytes out."""
_RATIO_FROM: Final = 200_000_000
"""A mask of few voxels packs a thousandfold, and may be so large."""
_GZIP: Final = b"\x1f\x8b"
_NRRD: Final = b"NRRD"


def check_growth(total: int, packed: int, most_bytes: int) -> None:
    """Refuse an archive that has given ``total`` bytes out of ``packed``, if that is too much.

    Raises
    ------
    BadRequestError
    """
    if total > most_bytes:
        raise BadRequestError(
            f"the archive unpacks to more than {total / 1e6:.0f} MB; at most "
            f"{most_bytes / 1e6:g} MB are taken"
        )
    if total > _RATIO_FROM and total > _RATIO * packed:
        raise BadRequestError(
            f"the archive unpacks to more than {_RATIO} times its size; pack it anew "
            "without emptiness, or send the files alone"
        )


def refuse_growth(path: Path, most_bytes: int) -> None:
    """Refuse a file that unpacks to more than may be, or grows too much in doing so.

    Raises
    ------
    BadRequestError
    """
    packed = path.stat().st_size
    if zipfile.is_zipfile(path):
        with contextlib.suppress(zipfile.BadZipFile, NotImplementedError):  # the reader's to tell
            with zipfile.ZipFile(path) as archive:
                total = sum(one.file_size for one in archive.infolist())
            check_growth(total, packed, most_bytes)
        return
    total = 0
    with path.open("rb") as handle, contextlib.suppress(OSError, EOFError, zlib.error):
        if _at_gzip(handle):
            with gzip.GzipFile(fileobj=handle) as stream:  # several may follow each other
                while piece := stream.read(_PIECE):
                    total += len(piece)
                    check_growth(total, packed, most_bytes)


def _at_gzip(handle: BinaryIO) -> bool:
    """Go to where a gzip stream begins in the file, if one does."""
    head = handle.read(_PIECE)
    start = 0 if head.startswith(_GZIP) else -1
    if head.startswith(_NRRD):
        ends = [end for mark in (b"\n\n", b"\r\n\r\n") if (end := head.find(mark) + len(mark)) >= 4]
        start = next((end for end in sorted(ends) if head[end : end + 2] == _GZIP), -1)
    if start >= 0:
        handle.seek(start)
    return start >= 0


MOST_FILES: Final = 20_000
MOST_DEPTH: Final = 6
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
    """Unpack a zip of slices or an OME-Zarr into a new folder; return it, or the one in it to read.

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
    for member in members:
        place = folder / _place(member)
        place.parent.mkdir(parents=True, exist_ok=True)
        with archive.open(member) as source, place.open("xb") as out:
            shutil.copyfileobj(source, out)  # never more than the size that was checked


def _place(member: zipfile.ZipInfo) -> PurePosixPath:
    """Where a member goes, relative to the folder."""
    name, mode = member.filename, member.external_attr >> 16
    parts = name.split("/")
    bad = stat.S_ISLNK(mode) or name.startswith("/") or len(parts) > MOST_DEPTH
    if bad or any(not _PART.fullmatch(part) or part in (".", "..") for part in parts):
        raise BadRequestError(f"the archive names {name[:80]!r}, which isn't unpacked")
    return PurePosixPath(*parts)


UPLOADS: Final = ".arriving"
_RUN_SCANS: Final = ("scan.tif", "scan.oct")
_SIDECARS: Final = (".json", ".yaml", ".yml")
REGISTERED: Final = ".registered"
"""Folder in a run of the registrations of other scans with its design."""


@dataclass(frozen=True)
class ScanRow:
    """A scan of the workspace: ``file~NAME`` or ``run~NAME``; 0 ``megabytes`` for a folder.

    ``registered`` are the runs with whose design its registration was begun.
    """

    scan: str
    megabytes: float
    modified: float
    registered: tuple[str, ...]


@dataclass(frozen=True)
class ScanMetadata(ScanOverrides):
    """What the user says of a scan; ``voxel_um`` is (x, y, z), instead of `voxel_mm`."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    voxel_um: tuple[float, float, float] | None = None

    def overrides(self) -> dict[str, Any]:
        """Return what was said, by the readers' names."""
        known = {key: value for key, value in asdict(self).items() if value is not None}
        if "voxel_um" in known:
            known["voxel_mm"] = [1e-3 * size for size in reversed(known.pop("voxel_um"))]
        return known


_METADATA: Final = TypeAdapter(ScanMetadata)


class ScanStore:
    """The folder ``scans`` of a workspace, and the scans in runs."""

    def __init__(self, workspace: Workspace, upload_mb: float) -> None:
        self._workspace, self._most_bytes = workspace, int(upload_mb * 1e6)
        self.folder = workspace.root / "scans"

    def rows(self) -> list[ScanRow]:
        """All scans, the newest first."""
        files, runs = (
            [path for path in self._workspace.found(pattern) if is_name(path.name)]
            for pattern in ("scans/*", "runs/*")
        )
        scans = [f"file~{one.name}" for one in files if one.suffix.lower() not in _SIDECARS]
        scans += [f"run~{one.name}" for one in runs if self._of_run(one.name)]
        return sorted(map(self.row, scans), key=lambda row: -row.modified)

    def _of_run(self, name: str) -> list[Path]:
        self._workspace.run(name)  # refuses what leads out of the workspace
        return [path for one in _RUN_SCANS for path in self._workspace.found(f"runs/{name}/{one}")]

    def unusable(self) -> list[str]:
        """Files that `rows` leaves out for their names."""
        return self._workspace.unusable_names("scans/*")

    def row(self, scan: str) -> ScanRow:
        """Return what a list shows of a scan."""
        path, begun = self.path(scan), self._workspace.root.glob(f"runs/*/{REGISTERED}/{scan}")
        state, (sort, _, name) = path.stat(), scan.partition("~")
        own = (name,) if sort == "run" else ()
        runs = (*own, *filter(is_name, sorted(place.parents[1].name for place in begun)))
        return ScanRow(scan, state.st_size / 1e6 if path.is_file() else 0.0, state.st_mtime, runs)

    def path(self, scan: str) -> Path:
        """Where a scan lies.

        Raises
        ------
        BadRequestError, NotFoundError
        """
        sort, _, name = scan.partition("~")
        if sort == "file":
            places = [self._workspace.inside(self.folder / checked_name(name))]
        elif sort == "run":
            places = self._of_run(name)
        else:
            raise BadRequestError(f"scan {scan[:80]!r} is neither file~NAME nor run~NAME")
        place = next((one for one in places if one.exists()), None)
        if place is None:
            raise NotFoundError(f"there is no scan {scan[:80]!r}")
        return place

    def take(self, file_name: str, stream: IO[bytes]) -> str:
        """Take in a scan as it comes, and return ``file~NAME``; a zip of slices is unpacked.

        Raises
        ------
        BadRequestError
            When it is no scan, too large, or unpacks to something that is.
        ConflictError
            When there is a scan of that name.
        """
        name = scan_name(file_name)
        self._refuse(name)
        place = self.folder / UPLOADS
        place.mkdir(exist_ok=True)
        with tempfile.TemporaryDirectory(dir=place, prefix=secrets.token_hex(4)) as arriving:
            arrived = Path(arriving) / name
            save_upload(stream, arrived, self._most_bytes)
            refuse_growth(arrived, self._most_bytes)
            if is_stack(arrived):
                name = checked_name(PurePath(name).stem)
                self._refuse(name)
                folder = Path(arriving) / "unpacked" / name
                arrived = unpack_stack(arrived, folder, self._most_bytes)
            try:
                recognise(arrived)
            except ScanFileError as exc:
                raise BadRequestError(str(exc).replace(f"{arrived.parent}/", "")) from exc
            arrived.replace(self.folder / name)
        return f"file~{name}"

    def said(self, scan: str) -> ScanMetadata:
        """Return what is said of a scan in a file beside it; nothing where that can't be read."""
        sidecar = find_sidecar(self.path(scan))
        try:
            data = read_yaml(sidecar.read_text(encoding="utf-8")) if sidecar else {}
            known = {key: value for key, value in dict(data).items() if key in NAMES}
            if "voxel_mm" in known:
                known["voxel_um"] = [1e3 * size for size in reversed(known.pop("voxel_mm"))]
            return _METADATA.validate_python(known)
        except (OSError, TypeError, ValueError, YAMLError):
            return ScanMetadata()

    def say(self, scan: str, metadata: ScanMetadata) -> None:
        """Keep what the user says of an uploaded scan, in a file beside it that all readers read.

        Raises
        ------
        ConflictError
            For a run's own scan, which says all itself.
        """
        if not scan.startswith("file~"):
            raise ConflictError("a run's own scan says all of itself; nothing is to be added")
        place = self.path(scan).with_suffix(".json")
        write_text(place, json.dumps(metadata.overrides(), indent=1) + "\n")

    def delete(self, scan: str) -> None:
        """Throw an uploaded scan away; a run's own goes with the run."""
        if not scan.startswith("file~"):
            raise ConflictError("a run's own scan stays with the run")
        path, kept = self.path(scan), self._workspace.private / "bin"
        kept.mkdir(parents=True, exist_ok=True)
        shutil.move(path, kept / f"{path.name}~{secrets.token_hex(4)}")
        path.with_suffix(".json").unlink(missing_ok=True)

    def _refuse(self, name: str) -> None:
        if (self.folder / name).exists():
            raise ConflictError(f"there is a scan {name!r} already; rename yours")


def scan_name(file_name: str) -> str:
    """The name that an uploaded scan is kept under."""
    name = usable_name(file_name)
    if PurePath(name).suffix.lower() in _SIDECARS:
        raise BadRequestError(f"{name} isn't a scan; give its volume")
    return name
