"""Preflight checks of a job, computed in a separate process and cached."""

from __future__ import annotations

import hashlib
import json
import math
import threading
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from design.files import write_text
from printctl.checks.set_up import Check
from printctl.errors import SafetyError
from printctl.machine.printing.job_table import JobTable
from printctl.web.errors import BadRequestError
from printctl.web.job.set_up import JobSetUp, Question
from printctl.web.worker import run_worker
from printctl.web.workspace import file_hash

_VERSION: Final = 2
_LONGEST_S: Final = 900.0


@dataclass(frozen=True)
class Preflight:
    """What is known of a job before it is printed.

    Attributes
    ----------
    key : str
        Of the job's content and the set-up; 32 hex digits.
    facts : dict
        As `printctl.web.job.check.check_job` gives them, but for the checks.
    checks : tuple of Check
    table : Path
    """

    key: str
    facts: dict[str, Any]
    checks: tuple[Check, ...]
    table: Path

    @property
    def passed(self) -> bool:
        """Whether nothing refuses the print."""
        return not any(check.refuses for check in self.checks)

    def rows(self) -> list[dict[str, Any]]:
        """For the page and the API: each check with its answer in a word."""
        return [row(check) for check in self.checks]


def row(check: Check) -> dict[str, Any]:
    """A check with its answer in a word; a question to a person has no numbers."""
    result = "passed" if check.passed else "failed" if check.refuses else "warning"
    asked = check.value == check.limit == 0 and not check.unit
    shown = {
        key: None if asked or not math.isfinite(number) else number
        for key, number in (("value", check.value), ("limit", check.limit))
    }
    return {**check.as_dict(), **shown, "result": result}


class Preflights:
    """Computes and caches preflight checks.

    Parameters
    ----------
    folder : Path
        Where they are kept.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._one = threading.Lock()

    def of(self, gcode: Path, set_up: JobSetUp) -> Preflight:
        """Check a job, or remember what was found; blocks for as long as the dry run takes.

        Raises
        ------
        BadRequestError
            When the job or the set-up can't be used; the message says why.
        ConflictError
            When the process that looks at it died or took too long.
        """
        key = key_of(gcode, set_up)
        answer, table = self._folder / f"{key}.json", self._folder / f"{key}.npz"
        with self._one:  # two dry runs at a time would be in each other's way, and in the print's
            if not (answer.is_file() and table.is_file()):
                self._folder.mkdir(parents=True, exist_ok=True)
                checked = _ask(Question(gcode, set_up, table))
                write_text(answer, json.dumps(checked) + "\n")
        return _read(key, answer, table)

    def known(self, gcode: Path, set_up: JobSetUp) -> Preflight | None:
        """What was found before; None where nobody has looked."""
        key = key_of(gcode, set_up)
        answer, table = self._folder / f"{key}.json", self._folder / f"{key}.npz"
        return _read(key, answer, table) if answer.is_file() and table.is_file() else None


def refuse(checks: list[Check]) -> None:
    """Refuse a print while anything fails.

    Raises
    ------
    SafetyError
    """
    failed = [check.sentence() for check in checks if check.refuses]
    if failed:
        raise SafetyError("the print isn't started: " + "; ".join(failed))


def key_of(gcode: Path, set_up: JobSetUp) -> str:
    """Hash of the file, its map and the set-up."""
    digest = hashlib.sha256(f"{_VERSION} {set_up.model_dump_json()} {gcode.name}".encode())
    for path in (gcode, gcode.with_suffix(".map.npz")):
        if path.is_file():
            digest.update(file_hash(path).encode())
    for name in profile_files(set_up):
        digest.update(file_hash(name).encode())
    return digest.hexdigest()[:32]


def profile_files(set_up: JobSetUp) -> list[Path]:
    """The set-up's profiles that are files of the user's, which may change."""
    names = [
        getattr(set_up, key) for key in ("printer", "syringe", "ink", "needle", "bath", "dish")
    ]
    parts = [Path(part) for name in names for part in name.split(",") if part]
    return [path for path in parts if path.is_file()]


@lru_cache(maxsize=4)
def load_table(path: Path) -> JobTable:
    """A job's table; the last few stay in memory."""
    return JobTable.load(path)


def _ask(question: Question) -> dict[str, Any]:
    name = question.gcode.name
    reply = run_worker(
        "printctl.web.job.check",
        said=question.to_json() + "\n",
        longest_s=_LONGEST_S,
        late=f"{name} couldn't be checked within {_LONGEST_S:g} s; try `printctl simulate` on it, "
        "or split the job",
        died=f"{name} couldn't be checked, the process ended",
    )
    checked: dict[str, Any] = json.loads(reply)
    if "error" in checked:
        raise BadRequestError(checked["error"])
    return checked


def _read(key: str, answer: Path, table: Path) -> Preflight:
    facts: dict[str, Any] = json.loads(answer.read_text(encoding="utf-8"))
    checks = tuple(Check(**one) for one in facts.pop("checks"))
    return Preflight(key, facts, checks, table)
