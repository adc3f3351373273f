"""Looks at a running print: service, small pictures and REST."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Final

from fastapi import Path as PathParam
from fastapi import Query, Response
from PIL import Image
from pydantic import Field

from printctl.machine.records.states import state_words
from printctl.observe.records import (
    ANSWERS,
    Answer,
    LookRecord,
    answer_look,
    is_paused_by_look,
    look_picture,
    outcome_words,
    proposal_words,
    read_answer,
    read_looks,
    refuse_without_observer,
    seen_words,
)
from printctl.web.core import Core
from printctl.web.errors import ConflictError, NotFoundError
from printctl.web.job.jobs import JobId
from printctl.web.job.prints import PrintReport, Prints
from printctl.web.rest import Asking, Body

_KEPT: Final = 64
_FORMATS: Final = ("PNG", "JPEG", "TIFF", "WEBP", "BMP")


@lru_cache(maxsize=_KEPT)
def small_picture(path: Path, changed_ns: int, width_px: int) -> bytes | None:
    """Return a picture as JPEG, at most so wide; None where it can't be read.

    A file that was changed at another time, ``changed_ns``, is another picture.
    """
    del changed_ns
    try:
        with Image.open(path, formats=_FORMATS) as seen:
            picture = seen.convert("RGB")
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return None
    if picture.width > width_px:
        high = max(1, round(picture.height * width_px / picture.width))
        picture = picture.resize((width_px, high), Image.Resampling.LANCZOS, reducing_gap=2.0)
    out = io.BytesIO()
    picture.save(out, "JPEG", quality=85)
    return out.getvalue()


Number = Annotated[int, PathParam(ge=1, le=10**6, description="Of the look, from 1.")]
Width = Annotated[int, Query(ge=64, le=4096, description="At most so wide, px.")]


class AnswerRequest(Body):
    """The operator's word on a look, as ``printctl observe answer`` takes it."""

    answer: Answer


@dataclass(frozen=True, kw_only=True)
class LookReport(LookRecord):
    """One look at an observed print, but for the state that only the observer needs.

    ``answer`` is the operator's word, for which the print ``waits``; ``pictured`` is when its
    picture was written, s since 1970, 0 for no picture. How much was ``seen``, what is ``proposed``
    and its ``outcome`` are words, empty for nothing.
    """

    control: Annotated[dict[str, Any], Field(exclude=True)] = field(default_factory=dict)
    answer: Answer | None
    waits: bool
    pictured: float
    seen: str
    proposed: str
    outcome: str


class LookService:
    """Looks at the workspace's prints; any thread may call."""

    def __init__(self, core: Core, prints: Prints) -> None:
        self._core, self._prints = core, prints

    def looks(self, job: JobId) -> list[LookReport]:
        """Every look at the job's last print, in their order; none of an earlier print's."""
        heard = self._prints.last(job)
        looks = read_looks(heard.folder, heard.journal.started)
        return [_reported(heard, one) for one in looks]

    def picture(self, job: JobId, number: Number, width: Width = 1600) -> Response:
        """A look's picture with what was expected and found, as JPEG; NotFoundError for none."""
        path = look_picture(self._core.workspace.print_folder(job), number)
        picture = None if path is None else small_picture(path, path.stat().st_mtime_ns, width)
        if picture is None:
            raise NotFoundError(f"there is no picture of look {number} of {job}")
        return Response(picture, media_type="image/jpeg", headers={"Cache-Control": "no-cache"})

    def answer(self, who: Asking, job: JobId, number: Number, given: AnswerRequest) -> LookReport:
        """Leave the operator's word for the observer; a stop needs no controls.

        Saying the same again does no harm. ConflictError when the print isn't held for that look,
        it was answered otherwise, or nobody listens.
        """
        word = given.answer
        if word != "stop":
            self._core.controls.require(who)
        look = next((one for one in self.looks(job) if one.number == number), None)
        if look is None:
            raise NotFoundError(f"there is no look {number} at the print of {job}")
        if look.answer == word:
            return look
        heard = self._prints.last(job)
        if look.answer is not None:
            raise ConflictError(f"look {number} was answered before: {look.answer}")
        if not look.waits:
            raise ConflictError(
                f"the print isn't waiting for an answer to look {number} "
                f"({state_words(heard.status.state)}); nothing was done. Answers are "
                f"{', '.join(ANSWERS)}, while that look pauses the print"
            )
        try:
            refuse_without_observer(heard.folder)
            answer_look(heard.folder, number, word)
        except ValueError as exc:
            raise ConflictError(str(exc)) from exc
        return next(one for one in self.looks(job) if one.number == number)


def _reported(heard: PrintReport, record: LookRecord) -> LookReport:
    """Return a look with the operator's word and what is read."""
    answer = read_answer(heard.folder, record.number) if record.asked else None
    picture = look_picture(heard.folder, record.number)
    return LookReport(
        **vars(record),
        answer=answer,
        waits=bool(record.asked)
        and answer is None
        and is_paused_by_look(heard.status, record.number),
        pictured=0.0 if picture is None else picture.stat().st_mtime,
        seen=seen_words(record),
        proposed=proposal_words(record),
        outcome=outcome_words(record, answer),
    )
