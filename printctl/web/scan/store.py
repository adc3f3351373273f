"""Scans stored in the workspace: upload, name, describe, find.

A scan is ``file~NAME``, a file or folder in ``scans``, or ``run~NAME``, the scan that a run made
of its simulated print.
"""

from __future__ import annotations

import json
import re
import secrets
import shutil
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path, PurePath
from typing import IO, Any, Final

from design.files import write_text
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.scan.unpacked_size import refuse_growth
from printctl.web.scan.unpacking import is_stack, unpack_stack
from printctl.web.security.uploads import save_upload
from printctl.web.workspace import Workspace, checked_name, is_name
from registration.errors import ScanFileError
from registration.files.readers import ScanOverrides
from registration.files.readers.metadata import find_sidecar
from registration.files.readers.read import recognise

UPLOADS: Final = ".arriving"
_RUN_SCANS: Final = ("scan.tif", "scan.oct")
_SIDECARS: Final = (".json", ".yaml", ".yml")


@dataclass(frozen=True)
class ScanRow:
    """A scan of the workspace.

    Attributes
    ----------
    scan : str
        ``file~NAME`` or ``run~NAME``.
    megabytes : float, MB
        0 for a folder.
    modified : float, s since 1970
    """

    scan: str
    megabytes: float
    modified: float


class ScanStore:
    """The folder ``scans`` of a workspace, and the scans in runs."""

    def __init__(self, workspace: Workspace, upload_mb: float) -> None:
        self._workspace, self._most_bytes = workspace, int(upload_mb * 1e6)

    @property
    def folder(self) -> Path:
        """Where uploaded scans lie."""
        return self._workspace.root / "scans"

    def rows(self) -> list[ScanRow]:
        """All scans, the newest first."""
        files = [
            path
            for path in self._workspace.found("scans/*")
            if is_name(path.name) and path.suffix.lower() not in _SIDECARS
        ]
        rows = [_row(f"file~{path.name}", path) for path in files]
        for name in _RUN_SCANS:
            rows += [
                _row(f"run~{path.parent.name}", path)
                for path in self._workspace.found(f"runs/*/{name}")
                if is_name(path.parent.name)
            ]
        return sorted(rows, key=lambda row: -row.modified)

    def path(self, scan: str) -> Path:
        """Where a scan lies.

        Raises
        ------
        BadRequestError, NotFoundError
        """
        sort, _, name = scan.partition("~")
        if sort == "file":
            path = self._workspace.scan(name)
            places = [path]
        elif sort == "run":
            places = [self._workspace.run(name) / one for one in _RUN_SCANS]
        else:
            raise BadRequestError(f"scan {scan[:80]!r} is neither file~NAME nor run~NAME")
        place = next((one for one in places if one.exists()), None)
        if place is None:
            raise NotFoundError(f"there is no scan {scan[:80]!r}")
        return place

    def take(self, file_name: str, stream: IO[bytes]) -> str:
        """Take in a scan as it comes; a zip of slices is unpacked. Its name is the file's.

        Returns
        -------
        str
            ``file~NAME``.

        Raises
        ------
        BadRequestError, ConflictError
        """
        name = scan_name(file_name)
        self._refuse(name)
        with self.arriving() as place:
            arrived = Path(place) / name
            save_upload(stream, arrived, self._most_bytes)
            return self.adopt(name, arrived)

    def adopt(self, file_name: str, arrived: Path) -> str:
        """Take in a scan that has arrived as a file of ours; as `take`."""
        name = scan_name(file_name)
        self._refuse(name)
        if arrived.stat().st_size == 0:
            raise BadRequestError(f"{name} is empty; export the scan again")
        refuse_growth(arrived, self._most_bytes)
        if not is_stack(arrived):
            _recognised(arrived).replace(self.folder / name)
            return f"file~{name}"
        name = checked_name(PurePath(name).stem)
        self._refuse(name)
        with self.arriving() as place:
            whole = unpack_stack(arrived, Path(place) / name, self._most_bytes)
            _recognised(whole).replace(self.folder / name)
        return f"file~{name}"

    def arriving(self) -> tempfile.TemporaryDirectory[str]:
        """A folder for what isn't whole yet; emptied at the end."""
        place = self.folder / UPLOADS
        place.mkdir(exist_ok=True)
        return tempfile.TemporaryDirectory(dir=place, prefix=secrets.token_hex(4))

    def said(self, scan: str) -> dict[str, Any]:
        """What the user said of a scan beside it."""
        sidecar = find_sidecar(self.path(scan))
        if sidecar is None:
            return {}
        try:
            data = json.loads(sidecar.read_text(encoding="utf-8"))
        except ValueError:
            return {}
        return data if isinstance(data, dict) else {}

    def say(self, scan: str, overrides: ScanOverrides) -> None:
        """Keep what the user says of an uploaded scan, in a file beside it that all readers read.

        Raises
        ------
        ConflictError
            For a run's own scan, which says all itself.
        """
        if not scan.startswith("file~"):
            raise ConflictError("a run's own scan says all of itself; nothing is to be added")
        path = self.path(scan)
        known = {key: value for key, value in asdict(overrides).items() if value is not None}
        write_text(path.with_suffix(".json"), json.dumps(known, indent=1) + "\n")

    def delete(self, scan: str) -> None:
        """Throw an uploaded scan away; a run's own goes with the run.

        Raises
        ------
        ConflictError, NotFoundError
        """
        if not scan.startswith("file~"):
            raise ConflictError("a run's own scan stays with the run")
        self.path(scan)
        path = self._workspace.scan(scan.removeprefix("file~"))
        kept = self._workspace.private / "bin"
        kept.mkdir(parents=True, exist_ok=True)
        goal = kept / f"{path.name}~{secrets.token_hex(4)}"
        shutil.move(path, goal)
        path.with_suffix(".json").unlink(missing_ok=True)

    def _refuse(self, name: str) -> None:
        if (self.folder / name).exists():
            raise ConflictError(f"there is a scan {name!r} already; rename yours")


def _recognised(arrived: Path) -> Path:
    try:
        recognise(arrived)
    except ScanFileError as exc:
        raise BadRequestError(str(exc).replace(f"{arrived.parent}/", "")) from exc
    return arrived


def scan_name(file_name: str) -> str:
    """A file name that can be ours: letters, digits, dots and lines only."""
    plain = PurePath(file_name.replace("\\", "/")).name
    name = re.sub(r"[^A-Za-z0-9._-]+", "_", plain).strip("._-")
    if PurePath(name).suffix.lower() in _SIDECARS:
        raise BadRequestError(f"{name} isn't a scan; give its volume")
    return checked_name(name[-64:].lstrip("._-"))


def _row(scan: str, path: Path) -> ScanRow:
    state = path.stat()
    return ScanRow(scan, state.st_size / 1e6 if path.is_file() else 0.0, state.st_mtime)
