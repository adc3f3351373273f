"""Operator's record of a print: lots, cells, operator; every change is kept."""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field

from design.files import write_text
from printctl.history.index import remember_meanwhile
from printctl.machine.records.folders import journal_of, notes_path
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.workspace import checked_name

Line = Annotated[str, Field(max_length=200)]
Text = Annotated[str, Field(max_length=10_000)]


LASTING_POINTS: Final = ("profile", "stop")
"""Points of the list before the start that hold for the next print, too: the others are of what
each print brings with it (dish, needle, syringe, warmth, the way to the start)."""


class PrintRecord(BaseModel):
    """What the operator notes before, while and after a print."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    operator: Line = Field(default="", description="Who prints.")
    ink_lot: Line = Field(default="", description="Lot of the ink.")
    bath_lot: Line = Field(default="", description="Lot and age of the bath.")
    needle_lot: Line = Field(default="", description="Lot or number of the needle.")
    cells: Line = Field(default="", description="Line or donor of the cells; empty for none.")
    passage: Annotated[int, Field(ge=0, le=1000)] | None = Field(
        default=None, description="Passage number."
    )
    density_per_ml: Annotated[float, Field(ge=0, le=1e12, allow_inf_nan=False)] | None = Field(
        default=None, description="Cells per mL of ink."
    )
    viability_percent: Annotated[float, Field(ge=0, le=100)] | None = Field(
        default=None, description="Living cells when they were mixed, %."
    )
    mixed_at: Annotated[float, Field(ge=0, le=1e11)] | None = Field(
        default=None, description="When cells and ink were mixed, s since 1970."
    )
    viability_min: Annotated[float, Field(gt=0, le=100_000)] | None = Field(
        default=None, description="Time that the cells have from then; the ink's own by default."
    )
    sterility: Text = Field(default="", description="Notes on sterility.")
    ticked: dict[str, bool] = Field(
        default_factory=dict, description="Points of the list before the start.", max_length=100
    )


class Records:
    """The records of a workspace, a file each in ``folder``; any thread may ask."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = threading.RLock()

    def current(self, job: str) -> str:
        """The record that the job's next or present print has; made if there is none."""
        with self._lock:
            current = self.of_job(job)
            if current and "ended" not in self.load(current[-1]):
                return current[-1]
            return self._new(job)

    def of_job(self, job: str) -> list[str]:
        """Records of a job, the oldest first."""
        return sorted(p.stem for p in self._folder.glob(f"{job}~[0-9]*.json"))

    def load(self, record: str) -> dict[str, Any]:
        """A record: ``id``, ``job``, ``values``, ``steps``, ``notes``, ``photos``, ``changes``."""
        path = self._path(record)
        try:
            values: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError as exc:
            raise NotFoundError(f"there is no record {record!r}") from exc
        except ValueError as exc:
            raise ConflictError(f"{path} can't be read ({exc}); restore it from a copy") from exc
        return values

    def values(self, record: str) -> PrintRecord:
        """What it says now."""
        return PrintRecord.model_validate(self.load(record)["values"])

    def change(self, record: str, who: str, changes: Mapping[str, Any]) -> PrintRecord:
        """Say something of a print; what was said before stays in the changes.

        Of ``ticked`` the points that are named change: two ticks may come at once. BadRequestError
        for a value that can't be.
        """
        with self._lock:
            found = self.load(record)
            try:
                if isinstance(ticked := changes.get("ticked"), dict):
                    changes = {**changes, "ticked": {**found["values"]["ticked"], **ticked}}
                new = PrintRecord.model_validate({**found["values"], **changes})
            except ValueError as exc:
                raise BadRequestError(f"the record can't say that: {exc}") from exc
            values = new.model_dump(mode="json")
            changed = {k: v for k, v in values.items() if found["values"].get(k) != v}
            if changed:
                found["values"] = values
                self._save(found, who, changed)
            return new

    def add(self, record: str, who: str, sort: str, entry: dict[str, Any]) -> None:
        """Add to one of its lists (``steps``, ``notes``, ``photos``), with time and who."""
        with self._lock:
            values = self.load(record)
            values.setdefault(sort, []).append({"at": time.time(), "who": who, **entry})
            self._save(values, who, {sort: entry})

    def mark(self, record: str, who: str, **changes: Any) -> None:
        """Set what the program itself knows: ``started``, ``print_id``, ``folder``, ``state``."""
        with self._lock:
            values = self.load(record)
            if any(values.get(key) != value for key, value in changes.items()):
                self._save({**values, **changes}, who, changes)

    def _new(self, job: str) -> str:
        """Make a record, with what the last print's says but for what holds for that one alone."""
        name = f"{job}~{time.strftime('%Y%m%d-%H%M%S', time.gmtime())}"
        before = self._last_started()
        values = PrintRecord.model_validate(before.get("values", {}))
        ticked = {one: True for one in LASTING_POINTS if values.ticked.get(one)}
        values = values.model_copy(
            update={"mixed_at": None, "viability_percent": None, "ticked": ticked}
        )
        record = {"id": name, "job": job, "values": values.model_dump(mode="json"), "changes": []}
        if before:
            record["remembered_from"] = before["id"]
        self._save(record, "", {})
        return name

    def _last_started(self) -> dict[str, Any]:
        """The record of the print that was started last; empty where none was."""
        by_time = sorted(self._folder.glob("*~*~*.json"), key=lambda one: one.stem[-15:])
        for path in reversed(by_time):
            with contextlib.suppress(NotFoundError, ConflictError, BadRequestError):
                record = self.load(path.stem)
                if record.get("started"):
                    return record
        return {}

    def _save(self, values: dict[str, Any], who: str, changes: Mapping[str, Any]) -> None:
        if changes:
            change = {"at": time.time(), "who": who, "said": changes}
            values["changes"] = [*values["changes"], change]
        text = json.dumps(values, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        write_text(self._path(values["id"]), text)
        if values.get("folder"):
            place, identity = Path(values["folder"]), values.get("print_id", "")
            journal = journal_of(place, identity, values["started"])
            write_text(notes_path(journal), text)
            if "operator" in changes or "started" in changes:
                remember_meanwhile(journal.parent)  # the history can be searched for people

    def _path(self, record: str) -> Path:
        for part in record.split("~"):
            checked_name(part)
        return self._folder / f"{record}.json"
