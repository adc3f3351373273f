"""Test prints with their folders, for records."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from firmware_profiles import Printer, load
from printctl.history.index import PrintHistory
from printctl.machine.records.journal import Journal, origin
from printctl.machine.records.sealing import sign_journal
from printctl.pipeline.past.past_print import PrintEntry

GCODE = b"G21\nG90\nG1 X1 ; a comment\n"


def printed(
    folder: Path,
    name: str = "part.gcode",
    started: float = 1e9,
    end: str = "done",
    who: str = "ada",
    message: str = "over",
    alarm: str = "the printer says 'cold'",
    relative: str = "../part.gcode",
) -> PrintEntry:
    """A job file, its print's journal, and its line in the history."""
    job, place = folder / name, folder / "print"
    place.mkdir(parents=True, exist_ok=True)
    job.write_bytes(GCODE)
    journal = Journal(place / "journal.log", sign=sign_journal)
    journal.add(
        "job",
        name=name,
        path=str(job),
        **({"relative": relative} if relative else {}),
        sha256=hashlib.sha256(GCODE).hexdigest(),
        lines=3,
        profile="generic_marlin",
        port="/dev/pts/3",
        pid=1,
        started=started,
        who=who,
        host="lab",
        **origin(load(Printer, "generic_marlin")),
    )
    journal.add("state", state="printing", message="printing")
    journal.add("state", state="paused", message="by hand")
    if alarm:
        journal.add("alarm", text=alarm)
    journal.add("end", state=end, message=message, done=3, error="", position_known=True)
    journal.close()
    history = PrintHistory()
    history.note(place)
    return next(e for e in history.entries() if e.journal == (place / "journal.log").resolve())


def with_run(folder: Path) -> None:
    """Beside the job, what a run leaves."""
    digest = hashlib.sha256(GCODE).hexdigest()
    stage = {"key": "k", "outputs": {"part.gcode": digest}, "summary": {}}
    recipe = {
        "name": "planar",
        "printer": {"syringe": "hamilton_1ml", "ink": "collagen_fresh", "bath": "gelatin_support"},
        "toolpath": {"needle": "fresh_150um"},
    }
    facts = {"recipe": recipe, "profiles": {"ink": {"name": "another"}}}
    told = {
        "schema": 1,
        "facts": facts,
        "stages": {"toolpath": {**stage, "seconds": 1, "peak_mb": 1}},
    }
    (folder / "manifest.json").write_text(json.dumps(told))
    (folder / "dry_run.json").write_text("{}")
    (folder / "report.html").write_text("<p>report")
    (folder / "report.json").write_text(
        json.dumps({"verdict": {"passed": True, "undecided": False, "reasons": ["All open"]}})
    )
