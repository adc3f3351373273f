"""Collect a print's existing files (G-code, run, report, notes, photos), checked by hash or time.

Files beside a print may be of a later one: the G-code counts only with the hash that the journal
has, a run only if it wrote that G-code, a report only if it was written after the print began and
before the next one did. They are looked for from the journal, so that a folder that was moved or
copied is found whole, and in what `keep_earlier` has put by.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from printctl.machine.records.folders import (
    NOTED,
    TIMELAPSE,
    film_file,
    first_job_record,
    journals_in,
    notes_path,
    read_notes,
)
from printctl.machine.records.journal import digest_of, read_records
from printctl.machine.records.record import JOURNAL
from printctl.pipeline.past.past_print import PrintEntry, entry_of
from printctl.run_folder.artefacts import GCODE, HTML, JOURNAL_FOLDER, JSON, PDF
from printctl.run_folder.manifest import MANIFEST, Manifest, digest_file, digest_json

EARLIER: Final = "earlier"
"""In a run's folder: evidence of its prints that a later run would have replaced."""
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
    hashes : dict of str to str
        SHA-256 of G-code, profiles, what the recipe names, what the run made, and so of each scan.
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
    hashes: dict[str, str] = field(default_factory=dict)

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
    job = _job_record(entry, missing)
    paths = _job_paths(entry, job)
    gcode = _gcode(entry, paths, missing)
    runs = {path.parent: Manifest.load(path.parent) for path in paths if path.name == GCODE}
    reports = {k: _report(one, entry) for k, one in runs.items() if _wrote(one) == entry.sha256}
    run = next((one for one in reports if reports[one]), next(iter(reports), None))
    if run is None and any(made.stages for made in runs.values()):
        missing.append("the run's folder has another design by now: its recipe isn't here")
    manifest, report = (runs[run], reports[run]) if run else (Manifest(Path()), {})
    planned = _there(run, _PLANNED) if run else {}
    if run and not report and _there(run, (HTML, JSON, PDF, *_MEASURED)):
        missing.append("the report in the run's folder is of another print")
    made = {k: v for record in manifest.stages.values() for k, v in record.outputs.items()}
    made |= manifest.report.get("files", {})
    if run:
        scans = manifest.stages["scan"].outputs if "scan" in manifest.stages else {}
        packed = {*planned, *report, *(name for name in scans if (run / name).is_file())}
        changed = [k for k in sorted(packed & {*made}) if digest_file(run / k) != made[k]]
        missing += [f"{name} was changed since its run: it is as it is now" for name in changed]
    numbers = read_json(report[JSON]) if JSON in report else None
    verdict = numbers.get("verdict") if isinstance(numbers, dict) else None
    found = Evidence(
        entry,
        gcode,
        run,
        manifest.facts,
        job,
        planned | (_there(run, (MANIFEST,)) if run else {}),
        report,
        dict(_noted(entry)),
        verdict if isinstance(verdict, dict) else None,
        tuple(missing),
    )
    named = {f"recipe/{k}": v for k, v in manifest.facts.get("inputs", {}).items()}
    named |= {f"run/{name}": digest for name, digest in made.items()}
    profiles = {f"profiles/{name}": digest_of(values) for name, values in found.profiles.items()}
    return replace(found, hashes={GCODE: entry.sha256, **named, **profiles})


def keep_earlier(folder: Path, facts: Mapping[str, Any]) -> Path | None:
    """Put the evidence of a run's print by before other inputs, or another build, replace it.

    Return the folder with the copies; None where there is no print, or nothing differs. A file that
    the recipe names and that wasn't there yet, as a scan before it is taken, makes no difference.
    """
    manifest = Manifest.load(folder)
    printed = first_job_record(folder / JOURNAL_FOLDER / JOURNAL).get("sha256")
    before = {**manifest.facts.get("inputs", {})}
    now = {name: digest for name, digest in facts["inputs"].items() if name in before}
    same = before == now and all(
        digest_json(manifest.facts.get(key)) == digest_json(facts[key])
        for key in ("recipe", "versions", "profiles")
    )
    if same or not printed or _wrote(manifest) != printed:
        return None
    kept = folder / EARLIER / time.strftime("%Y%m%d-%H%M%S", time.gmtime())
    kept.mkdir(parents=True)
    for path in _there(folder, (MANIFEST, GCODE, *_PLANNED, HTML, JSON, PDF, *_MEASURED)).values():
        shutil.copy2(path, kept)
    return kept


def read_json(path: Path) -> Any:
    """A JSON file's content; None when it can't be read or is far too large."""
    try:
        if path.stat().st_size > _LARGEST_JSON:
            return None
        text = path.read_text(encoding="utf-8")
        return json.loads(text, parse_constant=lambda _: None)  # no NaN: it's no JSON
    except (OSError, ValueError, RecursionError):
        return None


def _job_paths(entry: PrintEntry, job: Mapping[str, Any]) -> list[Path]:
    """Where the job's file may be: seen from the journal, put by, and where it was printed from."""
    if not entry.path:
        return []
    folder = entry.journal.parent
    near = os.path.normpath(folder / str(job.get("relative") or f"../{Path(entry.path).name}"))
    earlier = sorted(Path(near).parent.glob(f"{EARLIER}/*/{Path(near).name}"), reverse=True)
    return list(dict.fromkeys([Path(near), *earlier, Path(entry.path)]))


def _gcode(entry: PrintEntry, paths: list[Path], missing: list[str]) -> Path | None:
    there = [path for path in paths if path.is_file()]
    for path in there:
        try:
            if digest_file(path) == entry.sha256:
                return path
        except OSError as exc:
            missing.append(f"the G-code file {path} can't be read: {exc.strerror}")
    if there:
        missing.append(f"the G-code file {there[0]} was changed since the print")
    else:
        missing.append(f"the G-code file {entry.path or entry.file} isn't there any more")
    return None


def _wrote(manifest: Manifest) -> str:
    digests = (record.outputs.get(GCODE) for record in manifest.stages.values())
    return next((digest for digest in digests if digest), "")


def _there(folder: Path, names: tuple[str, ...]) -> dict[str, Path]:
    return {name: folder / name for name in names if (folder / name).is_file()}


def _report(manifest: Manifest, entry: PrintEntry) -> dict[str, Path]:
    """The files of a print's report in a run's folder; none where they are another print's."""
    run, folder = manifest.folder, entry.journal.parent
    if manifest.report.get("print", entry.id) != entry.id:
        return {}
    others = [entry_of(one) for one in journals_in(folder)]
    ends = min((o.started for o in others if o and o.started > entry.started), default=math.inf)
    own = run == folder.parent or run.parent == folder.parent / EARLIER
    files = _there(run, (HTML, JSON, PDF, *_MEASURED)).items()
    current = {k: p for k, p in files if entry.started <= p.stat().st_mtime < ends}
    return current if own and HTML in current else {}


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
