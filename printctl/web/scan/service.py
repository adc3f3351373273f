"""Service behind the Scan page: scans and registration processes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from printctl.run_folder.artefacts import NETWORK, SOLID
from printctl.web.core import Core
from printctl.web.design.recipes import Recipes
from printctl.web.design.runs import DetachedProcesses, RunProgress, Runs
from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.scan.slices import Volume, open_scan
from printctl.web.scan.store import REGISTERED, ScanMetadata, ScanStore
from registration.errors import ScanFileError


@dataclass(frozen=True)
class ScanNeeds:
    """What a scan lacks before it can be shown.

    Attributes
    ----------
    missing : tuple of str
        What its file doesn't say, as `ScanMetadata` names it; ``voxel_um`` for the voxel size.
    problem : str
        Why it can't be read; empty where it can.
    said : ScanMetadata
        What the user has said so far.
    """

    missing: tuple[str, ...]
    problem: str
    said: ScanMetadata


class ScanService:
    """Scans and their registration with runs."""

    def __init__(self, core: Core) -> None:
        self.core = core
        self.store = ScanStore(core.workspace, core.settings.upload_mb)
        self.processes = DetachedProcesses()
        self.runs = Runs(core.workspace, Recipes(core.workspace))

    def volume(self, scan: str) -> Volume:
        """Read a scan, and return what is known of its volume.

        Raises
        ------
        NotFoundError
        BadRequestError
            When it can't be read, or doesn't say what it must: voxel size and kin.
        """
        path = self.store.path(scan)
        try:
            return open_scan(path)[1]
        except ScanFileError as exc:
            raise BadRequestError(self._plain(exc)) from exc

    def needs(self, scan: str) -> ScanNeeds:
        """Return what has to be said of a scan, and what was.

        Raises
        ------
        NotFoundError, BadRequestError
        """
        path, said = self.store.path(scan), self.store.said(scan)
        try:
            open_scan(path)
        except ScanFileError as exc:
            names = ("voxel_um" if name == "voxel_mm" else name for name in exc.missing)
            return ScanNeeds(tuple(names), self._plain(exc), said)
        return ScanNeeds((), "", said)

    def _plain(self, exc: ScanFileError) -> str:
        """Without the folders of this machine."""
        plain = str(exc).replace(f"{self.store.folder}/", "")
        return plain.replace(f"{self.core.workspace.root}/", "")

    def register(self, scan: str, run: str, filled: bool = False) -> RunProgress:
        """Hold a scan against a run's design, in a process of its own; see `RegisterRequest`.

        Raises
        ------
        BadRequestError, NotFoundError, ConflictError
        """
        if scan == f"run~{run}":
            raise ConflictError(
                f"this is run {run!r}'s own scan; continue the run, which registers it"
            )
        model, folder = self.runs.folder(run), self.folder(scan, run)
        missing = [name for name in (SOLID, NETWORK) if not (model / name).is_file()]
        if missing:
            raise ConflictError(f"run {run!r} has no {missing[0]} yet; make its design first")
        self.volume(scan)
        if self.processes.going_on(scan, folder):
            raise ConflictError(f"{scan} is being registered with {run}; wait, or cancel it")
        command = ["register", str(self.store.path(scan).resolve())]
        command += ["--model", str(model.resolve()), "--out", str(folder.resolve())]
        command += ["--filled"] if filled else []
        self.processes.spawn(folder, command, self.core.workspace.root)
        return self.progress(scan, run)

    def folder(self, scan: str, run: str) -> Path:
        """Where the registration of a scan with a run lies; a run's own in the run.

        Raises
        ------
        BadRequestError, NotFoundError
        """
        self.store.path(scan)
        if scan == f"run~{run}":
            return self.runs.folder(run)
        return self.runs.folder(run) / REGISTERED / scan

    def progress(self, scan: str, run: str) -> RunProgress:
        """How far a registration is."""
        return self.processes.progress(f"{scan} with {run}", self.folder(scan, run))

    def cancel(self, scan: str, run: str) -> RunProgress:
        """Stop a registration.

        Raises
        ------
        ConflictError
        """
        if not self.processes.cancel(scan, self.folder(scan, run)):
            raise ConflictError(f"{scan} isn't being registered with {run}")
        return self.progress(scan, run)
