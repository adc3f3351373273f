"""REST of setting up a printer: the steps of `printctl commission`, their questions and answers."""

from __future__ import annotations

import logging
import threading
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final

from fastapi import APIRouter
from pydantic import Field

from firmware_profiles import Printer
from printctl.commissioning.state import EXPECTED, Commission, Question, UnansweredError
from printctl.commissioning.steps import do_next, next_step, overview, reopen
from printctl.failures import message_and_code
from printctl.web.core import Core
from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.profile_store import PARTS, ProfileStore
from printctl.web.rest import API, REFUSALS, Asking, Body

MOST_SAID: Final = 50
FILES: Final = frozenset({"scan", "widths"})
"""Answers that name a file."""
Name = Annotated[str, Field(min_length=1, max_length=64)]
Answer = Annotated[str, Field(max_length=2000)]

log = logging.getLogger(__name__)


class GoOn(Body):
    """Answers to questions by their keys; ``begin`` opens that step and those after it again."""

    answers: dict[Name, Answer] = Field(default_factory=dict, max_length=50)
    begin: Name | None = None


@dataclass
class Work:
    """What a step at work has said, and the question or problem that it stopped at."""

    working: bool = False
    said: list[str] = field(default_factory=list)
    question: Question | None = None
    problem: str = ""


class Commissioning:
    """Works in a thread of its own, one printer at a time; the state is in the printer's file."""

    def __init__(self, core: Core) -> None:
        self._core, self._store = core, ProfileStore(core.workspace.root)
        self._lock = threading.Lock()
        self._works: dict[str, Work] = {}

    def printers(self) -> list[str]:
        """Return the workspace's own printers, whose setting up can go on."""
        folder = self._store.folder(Printer)
        return sorted(path.stem for path in folder.glob("*.yaml"))

    def state(self, name: str) -> dict[str, Any]:
        """Return steps and results, and where the step at work stopped."""
        work = self._works.get(name, Work())
        return overview(self._kept(name)) | asdict(work)

    def go_on(self, name: str, body: GoOn, who: Asking) -> dict[str, Any]:
        """Do the steps that are left with these answers, until one asks or fails."""
        self._core.controls.require(who)
        kept = self._kept(name)
        given = {key: self._inside(kept, key, text) for key, text in body.answers.items()}
        with self._lock:
            if any(one.working for one in self._works.values()):
                raise ConflictError("a step is at work; wait until it asks something or ends")
            if body.begin is not None:
                reopen(kept, body.begin)
            work = self._works[name] = Work(working=next_step(kept) is not None)
        if work.working:
            threading.Thread(target=self._work, args=(kept, work, given), daemon=True).start()
        return self.state(name)

    def _inside(self, kept: Commission, key: str, answer: str) -> str:
        """Return an answer; one that names a file as its path in the workspace.

        Raises
        ------
        BadRequestError
            For a file elsewhere: the page isn't for reading the machine's files.
        """
        if key in PARTS:
            return self._store.resolve(PARTS[key], answer)
        if key not in FILES or answer == EXPECTED:
            return answer
        root = self._core.workspace.root.resolve()
        places = [(folder / answer).resolve() for folder in (root / "scans", kept.folder, root)]
        path = next((one for one in places if one.is_file()), places[0])
        if not path.is_relative_to(root):
            raise BadRequestError(
                f"{key} {answer[:80]!r} is outside the workspace {root}; put the file into "
                f"{root / 'scans'} (Scan page: upload)"
            )
        return str(path)

    def _kept(self, name: str) -> Commission:
        return Commission.load(str(self._store.new_file(Printer, name)))

    def _work(self, kept: Commission, work: Work, given: dict[str, str]) -> None:
        def say(text: str) -> None:
            work.said = [*work.said, text][-MOST_SAID:]

        try:
            while next_step(kept) is not None:
                do_next(kept, lambda question: given.pop(question.key, None), say, self._station)
        except UnansweredError as waits:
            work.question = waits.question
        except Exception as exc:
            known = message_and_code(exc)
            if known is None:
                log.exception("setting up %s", kept.printer)
            work.problem = known[0] if known else f"an internal error ({exc!r}); see the log"
        finally:
            work.working = False

    @property
    def _station(self) -> Path:
        return self._core.workspace.station


def router(service: Commissioning) -> APIRouter:
    """Routes under ``/api/v1/commissioning``."""
    routes = APIRouter(prefix=f"{API}/commissioning", tags=["printer"], responses=REFUSALS)
    routes.get("", summary="The workspace's own printers")(service.printers)
    routes.get("/{name}", summary="Steps of setting up a printer")(service.state)
    routes.post("/{name}", summary="Do the next step, with answers")(service.go_on)
    return routes
