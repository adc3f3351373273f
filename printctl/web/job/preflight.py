"""Preflight checks of a job, computed in a separate process and cached."""

from __future__ import annotations

import hashlib
import json
import math
import threading
import time
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from design.files import write_text
from printctl.checks.kinds import Kind
from printctl.checks.set_up import Check
from printctl.machine.prints.progress import JobTable
from printctl.pipeline.checked_order import Plan
from printctl.web.errors import BadRequestError
from printctl.web.job.jobs import keep_facts
from printctl.web.job.set_up import JobSetUp
from printctl.web.worker import run_worker
from printctl.web.workspace import Workspace, file_hash

_VERSION: Final = 5
_LONGEST_S: Final = 900.0
_REFUSED_AGAIN_S: Final = 60.0
"""So long a job that can't be used is refused without another look at it."""


@dataclass(frozen=True)
class Preflight:
    """What is known of a job before it is printed.

    ``key`` is of its content and the set-up, 32 hex digits; ``facts`` are as
    `printctl.web.job.check.check_job` gives them, but for the checks.
    """

    key: str
    facts: dict[str, Any]
    checks: tuple[Check, ...]
    table: Path

    @property
    def plan(self) -> Plan:
        """What its order needs of the checks."""
        return Plan.from_dict(self.facts)


@dataclass(frozen=True)
class CheckRow:
    """One check before the print; a question to a person has no numbers.

    ``value`` and ``limit`` are what was found and what is allowed, in ``unit``; ``place`` is a line
    of the G-code, or a key of a profile.
    """

    kind: Kind
    check: str
    result: Literal["passed", "failed", "warning"]
    value: float | None
    limit: float | None
    unit: str
    passed: bool
    place: str
    remedy: str
    weight: Literal["refuses", "warns"]


def row(check: Check) -> CheckRow:
    """Return a check with its answer in a word."""
    shown: dict[str, Any] = check.as_dict()
    no_numbers = check.value == check.limit == 0 and not check.unit
    for name in ("value", "limit"):
        if no_numbers or not math.isfinite(shown[name]):
            shown[name] = None
    return CheckRow(
        **shown, result="passed" if check.passed else "failed" if check.refuses else "warning"
    )


class PreflightReport(BaseModel):
    """The list of checks, and what the dry run found."""

    model_config = ConfigDict(extra="allow", frozen=True)

    job: str
    key: str = Field(description="Of the job's content and the set-up.")
    passed: bool = Field(description="Whether nothing refuses the print.")
    checks: list[CheckRow]
    sha256: str
    duration_s: float
    layers: int
    vessels: int
    ink_ul: float
    accepted: list[str] = Field(description="What failed and was accepted; the journal keeps it.")
    reload_at: list[int] = Field(description="Commands before each change of syringe.")


def report(job: str, checked: Preflight, before: list[CheckRow] | None = None) -> PreflightReport:
    """Return what was found of a job, behind the rows ``before``."""
    checks = [*(before or []), *map(row, checked.checks)]
    passed = all(one.result != "failed" for one in checks)
    return PreflightReport(job=job, key=checked.key, passed=passed, checks=checks, **checked.facts)


class Preflights:
    """Computes and caches preflight checks of a workspace's jobs."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace, self._folder = workspace, workspace.private / "preflight"
        self._one = threading.Lock()
        self._unusable: dict[str, tuple[float, str]] = {}

    def of(self, gcode: Path, set_up: JobSetUp) -> Preflight:
        """Check a job, or remember what was found; blocks for as long as the dry run takes.

        BadRequestError when the job or the set-up can't be used, ConflictError when the process
        that looks at it died or took too long.
        """
        if (known := self.known(gcode, set_up)) is not None:
            return known
        with self._one:  # two dry runs at a time would be in each other's way, and in the print's
            if (known := self.known(gcode, set_up)) is not None:
                return known
            key = key_of(gcode, set_up)
            self._folder.mkdir(parents=True, exist_ok=True)
            facts = _ask(gcode, set_up, self._folder / f"{key}.npz")
            if "error" in facts:
                self._unusable[key] = time.monotonic(), facts["error"]
                raise BadRequestError(facts["error"])
            write_text(self._folder / f"{key}.json", json.dumps(facts) + "\n")
        checked = _preflight(key, facts, self._folder)
        keep_facts(self._workspace, checked.facts)
        return checked

    def known(self, gcode: Path, set_up: JobSetUp) -> Preflight | None:
        """What was found before, or was raised then; None where nobody has looked."""
        key = key_of(gcode, set_up)
        at, message = self._unusable.get(key, (0.0, ""))
        if message and time.monotonic() - at < _REFUSED_AGAIN_S:
            raise BadRequestError(message)
        answer = self._folder / f"{key}.json"
        if not answer.is_file():
            return None
        facts = json.loads(answer.read_text(encoding="utf-8"))
        if facts["commands"] and not answer.with_suffix(".npz").is_file():
            return None
        return _preflight(key, facts, self._folder)


def key_of(gcode: Path, set_up: JobSetUp) -> str:
    """Hash of the file, its map, the set-up, and the user's own profiles, which may change."""
    digest = hashlib.sha256(f"{_VERSION} {set_up.model_dump_json()} {gcode.name}".encode())
    profiles = (Path(name) for names in set_up.profiles.values() for name in names)
    for path in (gcode, gcode.with_suffix(".map.npz"), *profiles):
        if path.is_file():
            digest.update(file_hash(path).encode())
    return digest.hexdigest()[:32]


@lru_cache(maxsize=4)
def load_table(path: Path) -> JobTable:
    """A job's table; the last few stay in memory."""
    return JobTable.load(path)


def _ask(gcode: Path, set_up: JobSetUp, table: Path) -> dict[str, Any]:
    question = {"gcode": str(gcode), "set_up": set_up.model_dump(mode="json"), "table": str(table)}
    reply = run_worker(
        "printctl.web.job.check",
        said=json.dumps(question) + "\n",
        longest_s=_LONGEST_S,
        late=f"{gcode.name} couldn't be checked within {_LONGEST_S:g} s; try `printctl simulate` "
        "on it, or split the job",
        died=f"{gcode.name} couldn't be checked, the process ended",
    )
    facts: dict[str, Any] = json.loads(reply)
    return facts


def _preflight(key: str, facts: dict[str, Any], folder: Path) -> Preflight:
    checks = tuple(map(Check.from_dict, facts["checks"]))
    rest = {name: value for name, value in facts.items() if name != "checks"}
    return Preflight(key, rest, checks, folder / f"{key}.npz")
