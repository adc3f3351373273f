"""Write and check a note that a simulated print's motion record is complete and of a given job.

By it a run takes over what was printed from the operator's page, instead of printing it again.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.files import write_text
from firmware_profiles import Printer
from printctl.sources import source_digest

EXECUTED: Final = "executed.npz"
_CODE: Final = ("sim", "printctl/machine", "firmware_profiles")
"""What decides what a simulated printer does with a job."""


def record_for(folder: Path) -> Path:
    """Path of the record of a print in ``folder``: a run's beside the print, else in it."""
    return folder.parent / EXECUTED if folder.name == "print" else folder / EXECUTED


def write_note(record: Path, sha256: str, printer: Printer, blocks: int) -> None:
    """Say what a whole record is of.

    Parameters
    ----------
    record : Path
    sha256 : str
        Of the job's file.
    printer : Printer
    blocks : int
        In the record.
    """
    write_text(_note(record), json.dumps(_facts(sha256, printer, blocks)) + "\n")


def is_complete_record(record: Path, sha256: str, printer: Printer) -> bool:
    """Whether a record is of this job on this printer, by this version, and whole."""
    try:
        note = json.loads(_note(record).read_text(encoding="utf-8"))
        with np.load(record) as data:
            blocks = len(data["line"])
    except (OSError, ValueError, KeyError):
        return False
    return bool(note == _facts(sha256, printer, blocks))


def _note(record: Path) -> Path:
    return record.with_suffix(".json")


def _facts(sha256: str, printer: Printer, blocks: int) -> dict[str, Any]:
    profile = json.dumps(printer.model_dump(mode="json"), sort_keys=True)
    return {
        "job": sha256,
        "printer": hashlib.sha256(profile.encode()).hexdigest(),
        "code": source_digest(_CODE),
        "blocks": blocks,
    }
