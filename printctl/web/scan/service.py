"""Service behind the Scan page: scans, slices, registration processes and their results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from printctl.run_folder.artefacts import HTML, NETWORK, SOLID
from printctl.web.core import Core
from printctl.web.design.recipes import Recipes
from printctl.web.design.runs import ARTEFACTS, DetachedProcesses, RunProgress, Runs
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.scan.findings import Findings, findings
from printctl.web.scan.slices import OpenScan, Slices, Volume, volume_of
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
    """Scans, their slices, and their registration with runs."""

    def __init__(self, core: Core) -> None:
        self.core = core
        self.store = ScanStore(core.workspace, core.settings.upload_mb)
        self.slices = Slices()
        self.processes = DetachedProcesses()
        self.runs = Runs(core.workspace, Recipes(core.workspace))

    def opened(self, scan: str) -> OpenScan:
        """A scan, read.

        Raises
        ------
        NotFoundError
        BadRequestError
            When it can't be read, or doesn't say what it must: voxel size and kin.
        """
        path = self.store.path(scan)
        try:
            return self.slices.open(path)
        except ScanFileError as exc:
            raise BadRequestError(self._plain(str(exc))) from exc

    def volume(self, scan: str) -> Volume:
        """Return what is known of a scan's volume.

        Raises
        ------
        NotFoundError, BadRequestError
        """
        return volume_of(self.opened(scan))

    def needs(self, scan: str) -> ScanNeeds:
        """Return what has to be said of a scan, and what was.

        Raises
        ------
        NotFoundError, BadRequestError
        """
        path, said = self.store.path(scan), self.store.said(scan)
        try:
            self.slices.open(path)
        except ScanFileError as exc:
            names = ("voxel_um" if name == "voxel_mm" else name for name in exc.missing)
            return ScanNeeds(tuple(names), self._plain(str(exc)), said)
        return ScanNeeds((), "", said)

    def say(self, scan: str, metadata: ScanMetadata) -> Volume:
        """Keep what the user says of an uploaded scan, and read it again.

        Raises
        ------
        NotFoundError, ConflictError
        BadRequestError
            When it can't be read yet; what was said is kept.
        """
        self.store.say(scan, metadata)
        return self.volume(scan)

    def _plain(self, message: str) -> str:
        """Without the folders of this machine."""
        return message.replace(f"{self.store.folder}/", "").replace(
            f"{self.core.workspace.root}/", ""
        )

    def register(self, scan: str, run: str, filled: bool = False) -> RunProgress:
        """Hold a scan against a run's design, in a process of its own.

        Parameters
        ----------
        scan : str
        run : str
        filled : bool
            Lumens are brighter than the gel.

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
        self.opened(scan)
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

    def findings(self, scan: str, run: str) -> Findings:
        """What the registration found.

        Raises
        ------
        NotFoundError
        """
        return findings(self.folder(scan, run))

    def files(self, scan: str, run: str) -> list[str]:
        """Files of a registration that may be fetched."""
        folder = self.folder(scan, run)
        return [name for name in ARTEFACTS if name != "recipe.yaml" and (folder / name).is_file()]

    def file(self, scan: str, run: str, name: str) -> Path:
        """A file of a registration.

        Raises
        ------
        NotFoundError
        """
        if name not in self.files(scan, run):
            raise NotFoundError(f"the registration has no file {name[:80]!r} that can be fetched")
        return self.folder(scan, run) / name

    def report(self, scan: str, run: str) -> Path:
        """The report's page.

        Raises
        ------
        NotFoundError
        """
        path = self.folder(scan, run) / HTML
        if not path.is_file():
            raise NotFoundError(f"{scan} isn't registered with {run} yet")
        return path
