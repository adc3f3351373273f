"""Notes after a print: photographs, viability, steps due, the record."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import yaml
from fastapi import File, UploadFile
from fastapi.responses import FileResponse
from PIL import Image, ImageOps
from pydantic import BaseModel, ConfigDict, Field

from design.files import write_bytes
from firmware_profiles import Bath, load
from printctl.analysis.flushing import FlushLimit, flush_limit
from printctl.checks.set_up import Budget
from printctl.machine.errors import LinkError
from printctl.web.core import Core
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.job.jobs import JobId
from printctl.web.job.machine import StationPrinting
from printctl.web.job.record import PrintRecord, Records
from printctl.web.job.set_up import JobSetUp
from printctl.web.rest import Asking, Body
from printctl.web.workspace import checked_name

_MOST_BYTES: Final = 30_000_000
_MOST_PIXELS: Final = 100_000_000
_LONGEST: Final = 2560
_FORMATS: Final = ("JPEG", "PNG", "WEBP", "TIFF")


def keep_photo(folder: Path, data: bytes) -> str:
    """Write a picture as JPEG, without what else was in its file; give its name.

    BadRequestError when it is too large or no picture.
    """
    if len(data) > _MOST_BYTES:
        raise BadRequestError(
            f"the photo has {len(data) / 1e6:.0f} MB, more than {_MOST_BYTES / 1e6:g} MB; make it "
            "smaller"
        )
    try:
        with Image.open(io.BytesIO(data), formats=_FORMATS) as seen:
            if seen.width * seen.height > _MOST_PIXELS:
                raise BadRequestError(
                    f"the photo has {seen.width} x {seen.height} pixels, more than "
                    f"{_MOST_PIXELS / 1e6:g} million; make it smaller"
                )
            seen.verify()
        with Image.open(io.BytesIO(data), formats=_FORMATS) as read:
            picture = ImageOps.exif_transpose(read).convert("RGB")
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as exc:
        raise BadRequestError(
            "that is no picture that can be read (JPEG, PNG, WebP or TIFF)"
        ) from exc
    picture.thumbnail((_LONGEST, _LONGEST))
    out = io.BytesIO()
    picture.save(out, "JPEG", quality=88)
    name = f"{time.strftime('%Y%m%d-%H%M%S', time.gmtime())}-{time.monotonic_ns() % 10**6:06d}.jpg"
    write_bytes(folder / name, out.getvalue())
    return name


_EVERY_S: Final = 2.0
_FILE: Final = Path(__file__).with_name("checklist.yaml")


@lru_cache(maxsize=1)
def checklist() -> dict[str, Any]:
    """The lists before and after a print, and starting values."""
    steps: dict[str, Any] = yaml.safe_load(_FILE.read_text(encoding="utf-8"))
    return steps


class Warming(BaseModel):
    """A heater to be warmed at a rate."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    heater: Annotated[str, Field(max_length=40)] = "bed"
    target_c: Annotated[float, Field(ge=0, le=60, description="°C.")]
    rate_c_min: Annotated[float, Field(gt=0, le=20, description="°C/min.")] = 1.0


class RampState(Warming):
    """Warming as it stands."""

    now_c: float | None = Field(description="What the heater has, °C.")
    set_c: float | None = Field(description="What it is set to now, °C.")
    going_on: bool = Field(description="Whether the target is still being raised.")
    message: str


class Ramp:
    """Warms one heater at a rate; at its end, or let go of, the heater keeps its target.

    ConflictError when the printer has no such heater.
    """

    def __init__(self, printing: StationPrinting, warming: Warming) -> None:
        there = printing.temperatures()
        if warming.heater not in there:
            raise ConflictError(
                f"there is no heater {warming.heater!r} (there is {', '.join(there) or 'none'}); "
                "connect the printer, or warm the bath by hand"
            )
        self._printing, self._warming = printing, warming
        self._from_c, self._since = there[warming.heater][0], time.monotonic()
        self._ended = threading.Event()
        self._message = "warming"
        self._thread = threading.Thread(target=self._work, name="ramp", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Stop raising the target."""
        self._ended.set()
        self._thread.join(5.0)

    def state(self) -> RampState:
        """Return it as it stands, with what the heater has now."""
        now_c, set_c = self._printing.temperatures().get(self._warming.heater, (None, None))
        return RampState(
            **self._warming.model_dump(),
            now_c=now_c,
            set_c=set_c,
            going_on=self._thread.is_alive(),
            message=self._message,
        )

    def _work(self) -> None:
        while not self._ended.is_set():
            wanted = ramped_c(self._from_c, self._warming, time.monotonic() - self._since)
            try:
                self._printing.heat(self._warming.heater, round(wanted, 1))
            except (LinkError, ConflictError) as exc:
                self._message = f"given up: {exc}"
                return
            if wanted == self._warming.target_c:
                self._message = "the target is set"
                return
            self._ended.wait(_EVERY_S)
        self._message = "let go of; the heater keeps its target"


def ramped_c(from_c: float, warming: Warming, seconds: float) -> float:
    """Where a ramp stands after so many seconds, °C; it never goes beyond its target."""
    way, target_c = warming.rate_c_min * seconds / 60.0, warming.target_c
    return min(from_c + way, target_c) if target_c >= from_c else max(from_c - way, target_c)


@dataclass(frozen=True)
class Viability:
    """State of the cells' time limit.

    ``minutes`` are since they were mixed, ``limit_min`` is how long they have, as ``source`` says;
    None where nobody said. It is ``late`` when the limit is passed, or will be before the print's
    end.
    """

    minutes: float | None
    limit_min: float | None
    source: str
    words: str
    state: Literal["unknown", "in time", "close", "late"]


def viability(
    record: PrintRecord, budget: Budget | None, now: float, remaining_s: float | None
) -> Viability:
    """Compare the time since mixing with the cells' limit.

    ``budget`` is of the ink or the form; what the record says comes first. ``now`` is in s since
    1970; ``remaining_s`` is the print's, None when none goes on.
    """
    limit = record.viability_min or (budget.minutes if budget else None)
    source = "the record" if record.viability_min else budget.source if budget else ""
    if record.mixed_at is None:
        text = "Nobody said when cells and ink were mixed; note it in the record."
        return Viability(None, limit, source, text, "unknown")
    minutes = (now - record.mixed_at) / 60.0
    if limit is None:
        text = f"{minutes:.0f} min since mixing; how long the cells have isn't known."
        return Viability(minutes, None, "", text, "unknown")
    text = f"{minutes:.0f} of {limit:.0f} min since mixing ({source})"
    end = minutes + (remaining_s or 0.0) / 60.0
    late, close = end > limit, end > 0.9 * limit
    if minutes > limit:
        text += f": {minutes - limit:.0f} min too long already."
    elif late:
        text += f": the print is expected to end after {end:.0f} min, too late."
    else:
        text += f"; {limit - end:.0f} min to spare{', which is close' if close else ''}."
    return Viability(
        minutes, limit, source, text, "late" if late else "close" if close else "in time"
    )


@dataclass(frozen=True)
class Step:
    """A step after the print; when that was ticked last, s since 1970, and by whom."""

    id: str
    text: str
    done: bool
    at: float | None
    who: str


@dataclass(frozen=True)
class Note:
    """A note of a print: when (s since 1970), whose, and what."""

    at: float
    who: str
    text: str


@dataclass(frozen=True)
class Photo:
    """A photo of a print: when it was added (s since 1970), by whom, its file's name."""

    at: float
    who: str
    name: str


Upload = Annotated[UploadFile, File()]


class TickRequest(Body):
    """A step done, or not after all."""

    done: bool = True


class NoteRequest(Body):
    """A note."""

    text: Annotated[str, Field(min_length=1, max_length=10_000)]


class Aftercare:
    """Steps to tick, notes, photos, the warming of the bath that a job's set-up names."""

    def __init__(
        self,
        core: Core,
        records: Records,
        printing: StationPrinting,
        set_up: Callable[[str], JobSetUp],
    ) -> None:
        self._core, self._records, self._printing = core, records, printing
        self._set_up = set_up
        self._lock = threading.Lock()
        self._ramp: Ramp | None = None

    def steps(self, job: JobId) -> list[Step]:
        """Steps after the job's last print that its bath has use for, each with who ticked it."""
        ticks = {one["step"]: one for one in self._listed(job, "steps")}
        bath, steps = self._bath(job), []
        for one in checklist()["after"]:
            if bath is None or "needs" not in one or getattr(bath, one["needs"]) is not None:
                tick = ticks.get(one["id"], {"done": False, "at": None, "who": ""})
                steps.append(Step(one["id"], one["text"], tick["done"], tick["at"], tick["who"]))
        return steps

    def tick(self, who: Asking, job: JobId, step: str, given: TickRequest) -> list[Step]:
        """Say that a step is done, or that it isn't after all; saying it twice does no harm."""
        now = {one.id: one.done for one in self.steps(job)}
        if step not in now:
            raise NotFoundError(f"there is no step {step[:80]!r}; there are {', '.join(now)}")
        if now[step] is not given.done:
            self._records.add(self._last(job), who.by, "steps", {"step": step, "done": given.done})
        return self.steps(job)

    def note(self, who: Asking, job: JobId, given: NoteRequest) -> list[Note]:
        """Write a note down; gives all."""
        if not given.text.strip():
            raise BadRequestError("the note is empty; write a word")
        self._records.add(self._last(job), who.by, "notes", {"text": given.text})
        return self.notes(job)

    def notes(self, job: JobId) -> list[Note]:
        """Notes of the job's last print."""
        return [Note(**one) for one in self._listed(job, "notes")]

    def add_photo(self, who: Asking, job: JobId, file: Upload) -> list[Photo]:
        """Keep a photo; gives all."""
        name = keep_photo(self._photos(job), file.file.read(_MOST_BYTES + 1))
        self._records.add(self._last(job), who.by, "photos", {"name": name})
        return self.photos(job)

    def photos(self, job: JobId) -> list[Photo]:
        """Photos of the job's last print."""
        return [Photo(**one) for one in self._listed(job, "photos")]

    def photo(self, job: JobId, name: str) -> FileResponse:
        """File of a photo; NotFoundError for none."""
        path = self._photos(job) / checked_name(name)
        if path.suffix != ".jpg" or not path.is_file():
            raise NotFoundError(f"there is no photo {name!r} of this print")
        return FileResponse(self._core.workspace.inside(path), media_type="image/jpeg")

    def flush(self, job: JobId, wall_shear_pa: float | None = None) -> FlushLimit | None:
        """How hard the channels may be flushed; None where no flow was solved."""
        allowed = wall_shear_pa or float(checklist()["flush"]["wall_shear_pa"])
        return flush_limit(self._core.workspace.job_file(job).with_name("flow.csv"), allowed)

    def melt_out_of(self, job: JobId) -> Warming:
        """Return how the bath of a job's print is melted out; 37 °C where its profile is silent."""
        bath = self._bath(job)
        target = bath.melt_out_c if bath is not None and bath.melt_out_c else 37.0
        return Warming(target_c=target, rate_c_min=checklist()["melt_out"]["rate_c_min"])

    def melt_out(self, who: Asking, warming: Warming) -> RampState:
        """Warm slowly; a ramp that goes on is replaced."""
        self._core.controls.require(who)
        with self._lock:
            self.close()
            self._ramp = Ramp(self._printing, warming)
            return self._ramp.state()

    def melting(self) -> RampState | None:
        """The ramp as it stands; None where there was none."""
        with self._lock:
            return None if self._ramp is None else self._ramp.state()

    def stop_melting(self) -> RampState | None:
        """Raise the target no further; needs no controls."""
        with self._lock:
            self.close()
        return self.melting()

    def close(self) -> None:
        """Let go of the heater, which keeps its target."""
        if self._ramp is not None:
            self._ramp.end()

    def _bath(self, job: str) -> Bath | None:
        """The bath that the job was printed in, as far as that was said."""
        name = next(iter(self._set_up(job).profiles["bath"]), "")
        return load(Bath, name) if name else None

    def _last(self, job: str) -> str:
        """Record of the last print that was started, else the one being filled in."""
        self._core.workspace.job_file(job)
        for record in reversed(self._records.of_job(job)):
            if self._records.load(record).get("started"):
                return record
        return self._records.current(job)

    def _listed(self, job: str, sort: str) -> list[dict[str, Any]]:
        """Return a list of the record of the job's last print."""
        self._core.workspace.job_file(job)
        if not self._records.of_job(job):
            return []
        listed: list[dict[str, Any]] = self._records.load(self._last(job)).get(sort, [])
        return listed

    def _photos(self, job: str) -> Path:
        workspace = self._core.workspace
        return workspace.inside(workspace.print_folder(job) / "photos")
