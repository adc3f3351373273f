"""Collect a print's existing files (G-code, run, report, notes, photos), checked by hash or time.

Files beside a print may be of a later one: the G-code counts only with the hash that the journal
has, a run only if it wrote that G-code, a report only if it was written after the print began.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from printctl.machine.records.folders import NOTED, TIMELAPSE, film_file, notes_path, read_notes
from printctl.machine.records.journal import read_records
from printctl.machine.records.record import JOURNAL
from printctl.pipeline.past_print import PrintEntry
from printctl.run_folder.artefacts import HTML, JSON, PDF
from printctl.run_folder.manifest import MANIFEST, Manifest, digest_file

GCODE: Final = "part.gcode"
PHOTOS: Final = "photos"
_LARGEST_JSON: Final = 64 * 2**20
_MEASURED: Final = ("registration.json", "vessels.csv", "defects.csv", "sections.csv")
_PLANNED: Final = ("dry_run.json", "lumens.json", "compensation.yaml")


@dataclass(frozen=True)
class Evidence:
    """What was found of a print.

    Attributes
    ----------
    entry : PrintEntry
    gcode : Path or None
        The file that was sent; None when it is gone or was changed since.
    run : Path or None
        Folder of the run that wrote it.
    facts : dict
        Of the run's manifest: recipe with all defaults, profiles, versions.
    job : dict
        The journal's job record.
    planned, report, noted : dict of str to Path
        Files by what they are called in a bundle: checks before the print, what was found
        afterwards, what the operator noted.
    verdict : dict or None
        Of the report: ``passed``, ``undecided``, ``reasons``.
    missing : tuple of str
        What there was once, and isn't any more or isn't of this print; for people.
    """

    entry: PrintEntry
    gcode: Path | None = None
    run: Path | None = None
    facts: dict[str, Any] = field(default_factory=dict)
    job: dict[str, Any] = field(default_factory=dict)
    planned: dict[str, Path] = field(default_factory=dict)
    report: dict[str, Path] = field(default_factory=dict)
    noted: dict[str, Path] = field(default_factory=dict)
    verdict: dict[str, Any] | None = None
    missing: tuple[str, ...] = ()

    @property
    def profiles(self) -> dict[str, dict[str, Any]]:
        """Profiles as they were: the printer's by the journal, the others by the run."""
        profiles = {k: v for k, v in self.facts.get("profiles", {}).items() if v}
        if isinstance(self.job.get("printer"), dict):
            profiles["printer"] = self.job["printer"]
        return profiles

    def note(self) -> dict[str, Any]:
        """What the operator noted; empty where there is nothing."""
        return read_notes(self.entry.journal)


def evidence(entry: PrintEntry) -> Evidence:
    """Look for what there is of a print."""
    missing: list[str] = []
    gcode = _gcode(entry, missing)
    run = _run_folder(entry)
    manifest = Manifest.load(run) if run is not None else None
    if manifest is not None and _wrote(manifest) != entry.sha256:
        run, manifest = None, None
        missing.append("the run's folder has another design by now: its recipe isn't here")
    report = _report(run, entry, missing) if run is not None else {}
    numbers = read_json(report[JSON]) if JSON in report else None
    verdict = numbers.get("verdict") if isinstance(numbers, dict) else None
    return Evidence(
        entry,
        gcode,
        run,
        manifest.facts if manifest is not None else {},
        _job_record(entry, missing),
        _there(run, _PLANNED) if run is not None else {},
        report,
        dict(_noted(entry)),
        verdict if isinstance(verdict, dict) else None,
        tuple(missing),
    )


def read_json(path: Path) -> Any:
    """A JSON file's content; None when it can't be read or is far too large."""
    try:
        if path.stat().st_size > _LARGEST_JSON:
            return None
        text = path.read_text(encoding="utf-8")
        return json.loads(text, parse_constant=lambda _: None)  # no NaN: it's no JSON
    except (OSError, ValueError, RecursionError):
        return None


def _gcode(entry: PrintEntry, missing: list[str]) -> Path | None:
    path = Path(entry.path)
    if not entry.path or not path.is_file():
        missing.append(f"the G-code file {entry.path or entry.file} isn't there any more")
        return None
    try:
        same = digest_file(path) == entry.sha256
    except OSError as exc:
        missing.append(f"the G-code file {path} can't be read: {exc.strerror}")
        return None
    if not same:
        missing.append(f"the G-code file {path} was changed since the print")
    return path if same else None


def _run_folder(entry: PrintEntry) -> Path | None:
    path = Path(entry.path)
    return path.parent if path.name == GCODE and (path.parent / MANIFEST).is_file() else None


def _wrote(manifest: Manifest) -> str:
    digests = (record.outputs.get(GCODE) for record in manifest.stages.values())
    return next((digest for digest in digests if digest), "")


def _there(folder: Path, names: tuple[str, ...]) -> dict[str, Path]:
    return {name: folder / name for name in names if (folder / name).is_file()}


def _report(run: Path, entry: PrintEntry, missing: list[str]) -> dict[str, Path]:
    files = _there(run, (HTML, JSON, PDF, *_MEASURED))
    if not files:
        return {}
    latest = entry.journal.name == JOURNAL and entry.journal.parent.parent == run
    current = {k: p for k, p in files.items() if p.stat().st_mtime >= entry.started}
    if latest and HTML in current:
        return current
    missing.append("the report in the run's folder is of another print")
    return {}


def _job_record(entry: PrintEntry, missing: list[str]) -> dict[str, Any]:
    try:
        for record in read_records(entry.journal):
            if record is not None and record.get("t") == "job":
                return record
    except OSError as exc:
        missing.append(f"the journal {entry.journal} can't be read: {exc.strerror}")
    return {}


def _noted(entry: PrintEntry) -> Iterator[tuple[str, Path]]:
    """The operator's record with the photos that it names, and the film."""
    record, folder = notes_path(entry.journal), entry.journal.parent
    if record.is_file():
        yield NOTED, record
    for name in _named_photos(entry):
        path = folder / PHOTOS / name
        if path.is_file() and not path.is_symlink() and not path.parent.is_symlink():
            yield f"{PHOTOS}/{name}", path
    film = film_file(folder, entry.started)
    if film.is_file() and not film.is_symlink():
        yield f"{TIMELAPSE}/{film.name}", film


def _named_photos(entry: PrintEntry) -> list[str]:
    """Plain file names only: the folder may be another's, and its record say anything."""
    listed = read_notes(entry.journal).get("photos")
    names = (
        [one.get("name") for one in listed if isinstance(one, dict)]
        if isinstance(listed, list)
        else []
    )
    return sorted({name for name in names if isinstance(name, str) and name == Path(name).name})
