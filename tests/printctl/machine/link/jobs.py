"""Test jobs, parsed by the firmware family that their commands need."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import yaml

from firmware_profiles import Printer, load
from printctl.machine.job import job
from printctl.machine.job.job import Job
from printctl.machine.records.journal import Journal

MARLIN: Final = load(Printer, "generic_marlin")
KLIPPER: Final = load(Printer, "klipper_bioprinter")
_NAMES: Final = (b"SET_", b"ACTIVATE_")


def parse_job(data: bytes, name: str, printer: Printer | None = None) -> Job:
    """`printctl.machine.job.job.parse_job`."""
    named = any(line.startswith(_NAMES) for line in data.upper().splitlines())
    return job.parse_job(data, name, printer or (KLIPPER if named else MARLIN))


def with_codes(printer: Printer, *codes: str) -> Printer:
    """A printer whose profile names codes as its machine's own."""
    return printer.model_copy(update={"extra_commands": codes})


def load_job(path: Path, printer: Printer = MARLIN) -> Job:
    """`printctl.machine.job.job.load_job`."""
    return (
        parse_job(path.read_bytes(), path.name, printer)
        if path.is_file()
        else job.load_job(path, printer)
    )


def quick_profile(folder: Path) -> str:
    """Write a printer that doesn't reset when its port is opened: no wait for its boot."""
    path = folder / "quick.yaml"
    facts = MARLIN.model_copy(update={"resets_on_connect": False})
    path.write_text(yaml.safe_dump(facts.model_dump(mode="json")))
    return str(path)


# --- test journals, closed at each test's end (`tests/printctl/machine/link/conftest.py`)
_OPEN: Final[list[Journal]] = []


def journal_in(folder: Path) -> Journal:
    """Open a print's journal."""
    journal = Journal(folder / "journal.log")
    _OPEN.append(journal)
    return journal


def close_all() -> None:
    """Close those that were opened."""
    while _OPEN:
        _OPEN.pop().close()
