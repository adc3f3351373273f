"""Record ticked steps, notes and photos after a print; start bath warming; give the flush limit."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from firmware_profiles import Bath, load
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.errors import BadRequestError, NotFoundError
from printctl.web.job.machine import Printing
from printctl.web.job.photos import keep_photo, photo_file
from printctl.web.job.record import Records
from printctl.web.job.set_up import JobSetUp
from printctl.web.job.steps_after import FlushLimit, Ramp, checklist, flush_limit, steps_for

_LONGEST_NOTE = 10_000


class Aftercare:
    """Steps to tick, notes, photos, the bath's warming.

    Parameters
    ----------
    core : Core
    records : Records
    printing : Printing
    set_up : function
        Gives a job's set-up, which names the bath.
    """

    def __init__(
        self,
        core: Core,
        records: Records,
        printing: Printing,
        set_up: Callable[[str], JobSetUp],
    ) -> None:
        self._core, self._records, self._printing = core, records, printing
        self._set_up = set_up
        self._lock = threading.Lock()
        self._ramp: Ramp | None = None

    def close(self) -> None:
        """Let go of the heater, which keeps its target."""
        if self._ramp is not None:
            self._ramp.end()

    @property
    def warming(self) -> bool:
        """Whether there is a ramp to tell of."""
        return self._ramp is not None

    def steps(self, job: str) -> list[dict[str, Any]]:
        """Steps after the job's last print, each with who ticked it when."""
        record = self._record(job)
        ticks = {} if record is None else {one["step"]: one for one in record.get("steps", [])}
        return [
            {
                **step,
                "done": bool(ticks.get(step["id"], {}).get("done")),
                "at": ticks.get(step["id"], {}).get("at"),
                "who": ticks.get(step["id"], {}).get("who", ""),
            }
            for step in steps_for(self.bath(job))
        ]

    def tick(self, who: Principal, job: str, step: str, done: bool) -> list[dict[str, Any]]:
        """Say that a step is done, or that it isn't after all; saying it twice does no harm."""
        now = {one["id"]: one["done"] for one in self.steps(job)}
        if step not in now:
            raise NotFoundError(f"there is no step {step[:80]!r}; there are {', '.join(now)}")
        if now[step] is not done:
            self._records.add(self._last(job), _name(who), "steps", {"step": step, "done": done})
        return self.steps(job)

    def note(self, who: Principal, job: str, text: str) -> list[dict[str, Any]]:
        """Write a note down; gives all."""
        if not text.strip() or len(text) > _LONGEST_NOTE:
            raise BadRequestError(f"a note has 1 to {_LONGEST_NOTE} characters, not {len(text)}")
        self._records.add(self._last(job), _name(who), "notes", {"text": text})
        return self.notes(job)

    def notes(self, job: str) -> list[dict[str, Any]]:
        """Notes of the job's last print."""
        record = self._record(job)
        return [] if record is None else list(record.get("notes", []))

    def add_photo(self, who: Principal, job: str, data: bytes) -> list[dict[str, Any]]:
        """Keep a photo; gives all."""
        name = keep_photo(self._photos(job), data)
        self._records.add(self._last(job), _name(who), "photos", {"name": name})
        return self.photos(job)

    def photos(self, job: str) -> list[dict[str, Any]]:
        """Photos of the job's last print."""
        record = self._record(job)
        return [] if record is None else list(record.get("photos", []))

    def photo(self, job: str, name: str) -> Path:
        """File of a photo."""
        return photo_file(self._photos(job), name)

    def bath(self, job: str) -> Bath | None:
        """The bath that the job was printed in, as far as that was said."""
        name = self._set_up(job).bath
        return load(Bath, name) if name else None

    def flush(self, job: str, wall_shear_pa: float | None = None) -> FlushLimit | None:
        """How hard the channels may be flushed; None where no flow was solved."""
        allowed = wall_shear_pa or float(checklist()["flush"]["wall_shear_pa"])
        return flush_limit(self._core.workspace.job_file(job).with_name("flow.csv"), allowed)

    def melt_out(
        self, who: Principal, heater: str, target_c: float, rate_c_min: float
    ) -> dict[str, Any]:
        """Warm slowly; a ramp that goes on is replaced."""
        self._core.controls.require(who)
        with self._lock:
            if self._ramp is not None:
                self._ramp.end()
            self._ramp = Ramp(self._printing, heater, target_c, rate_c_min)
            return self._ramp.to_dict()

    def melting(self) -> dict[str, Any] | None:
        """The ramp as it stands; None where there was none."""
        with self._lock:
            return None if self._ramp is None else self._ramp.to_dict()

    def stop_melting(self) -> dict[str, Any] | None:
        """Raise the target no further; needs no controls."""
        with self._lock:
            if self._ramp is not None:
                self._ramp.end()
            return None if self._ramp is None else self._ramp.to_dict()

    def _last(self, job: str) -> str:
        """Record of the last print that was started, else the one being filled in."""
        self._core.workspace.job_file(job)
        for record in reversed(self._records.of_job(job)):
            if self._records.load(record).get("started"):
                return record
        return self._records.current(job)

    def _record(self, job: str) -> dict[str, Any] | None:
        self._core.workspace.job_file(job)
        return self._records.load(self._last(job)) if self._records.of_job(job) else None

    def _photos(self, job: str) -> Path:
        return self._core.workspace.print_folder(job) / "photos"


def _name(who: Principal) -> str:
    return who.name or who.id
