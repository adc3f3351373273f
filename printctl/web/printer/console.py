"""Console and macros of the printer."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Final, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from design.files import write_text
from firmware_profiles import Printer
from firmware_profiles.yaml_file import read_yaml
from printctl.checks.gate import Refusal, judge_stored_line
from printctl.machine.errors import LinkError
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError, WebError
from printctl.web.printer.service import PrinterService
from printctl.web.rest import Asking, Body

KEPT: Final = 500
LONGEST: Final = 200


class ConsoleLine(Body):
    """A line for the console."""

    text: Annotated[str, Field(min_length=1, max_length=LONGEST)]


Replies = dict[Literal["replies"], list[str]]


@dataclass(frozen=True)
class Entry:
    """Entry of the console; ``at_s`` is since 1970.

    ``refused`` says why it wasn't sent, or failed; empty when it went out.
    """

    number: int
    at_s: float
    who: str
    text: str
    replies: tuple[str, ...] = ()
    refused: str = ""


class Console:
    """Sends lines and keeps what came of them, the same for all browsers."""

    def __init__(self, service: PrinterService) -> None:
        self._service = service
        self._entries: deque[Entry] = deque(maxlen=KEPT)
        self._count = 0
        self._lock = threading.Lock()

    def console(self, after: int = 0) -> list[Entry]:
        """Return those with a number above ``after``, oldest first; a route."""
        with self._lock:
            return [entry for entry in self._entries if entry.number > after]

    def command(self, body: ConsoleLine, who: Asking) -> Replies:
        """Send a line; a route."""
        return {"replies": self.send(who, body.text)}

    def send(self, who: Principal, typed: str) -> list[str]:
        """Send a line; give the reply."""
        text = checked_line(typed)
        try:
            replies = self._service.ask(who).command(text)
        except (LinkError, WebError) as exc:
            self._keep(who, text, refused=str(exc))
            raise
        self._keep(who, text, tuple(replies))
        return replies

    def _keep(
        self, who: Principal, text: str, replies: tuple[str, ...] = (), refused: str = ""
    ) -> None:
        with self._lock:
            self._count += 1
            entry = Entry(self._count, time.time(), who.name, text, replies, refused)
            self._entries.append(entry)
        self._service.core.events.publish("console", **asdict(entry))


def checked_line(typed: str) -> str:
    """Return one command as it can be sent; BadRequestError for no line, or more than one."""
    text = typed.strip()
    if not text or len(text) > LONGEST or not (text.isascii() and text.isprintable()):
        raise BadRequestError(
            f"{typed[:40]!r} isn't one command: 1 to {LONGEST} printable ASCII characters on one "
            "line"
        )
    return text


MOST: Final = 50


class Macro(BaseModel):
    """Commands under a name.

    They are sent one after the other, as if typed into the console, until one is refused.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, Field(min_length=1, max_length=40, pattern=r"^\S.*$")]
    commands: Annotated[tuple[str, ...], Field(min_length=1, max_length=100)]


class MacroFile(BaseModel):
    """Macros of a printer profile."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    macros: Annotated[tuple[Macro, ...], Field(max_length=MOST)] = ()

    def without(self, name: str) -> list[Macro]:
        """Return all but the one of that name."""
        return [one for one in self.macros if one.name != name]


class Macros:
    """Reads, checks, keeps and runs macros; its methods are routes."""

    def __init__(self, service: PrinterService, console: Console) -> None:
        self._service, self._console = service, console
        self._lock = threading.Lock()

    def listed(self, profile: str) -> MacroFile:
        """Return those of a printer profile."""
        path = self._path(profile)
        if not path.is_file():
            return MacroFile()
        try:
            return MacroFile.model_validate(read_yaml(path.read_text("utf-8")))
        except (yaml.YAMLError, UnicodeDecodeError, ValidationError) as exc:
            raise ConflictError(f"{path} holds no macros: {exc}; mend or remove it") from exc

    def save(self, profile: str, body: Macro, who: Asking) -> MacroFile:
        """Keep a macro, in place of one of the same name, if the console would take its lines."""
        self._service.core.controls.require(who)
        self._check(profile, body)
        with self._lock:
            kept = self.listed(profile).without(body.name)
            if len(kept) >= MOST:
                raise ConflictError(f"there are {MOST} macros already; remove one first")
            return self._write(profile, [*kept, body])

    def remove(self, profile: str, name: str, who: Asking) -> MacroFile:
        """Forget a macro."""
        self._service.core.controls.require(who)
        with self._lock:
            before = self.listed(profile)
            kept = before.without(name)
            if len(kept) == len(before.macros):
                raise NotFoundError(f"{profile} has no macro {name!r}")
            return self._write(profile, kept)

    def run(self, name: str, who: Asking) -> Replies:
        """Send a macro's commands to the printer that is connected, until one is refused."""
        self._service.ask(who)
        profile = self._service.status.printer
        macro = next((one for one in self.listed(profile).macros if one.name == name), None)
        if macro is None:
            raise NotFoundError(f"{profile} has no macro {name!r}")
        self._check(profile, macro)
        with self._service.moving(who):
            sent = [self._console.send(who, text) for text in macro.commands]
        return {"replies": [reply for replies in sent for reply in replies]}

    def _check(self, profile: str, macro: Macro) -> None:
        printer = self._service.store.load(Printer, profile)
        for number, text in enumerate(macro.commands, 1):
            verdict = judge_stored_line(checked_line(text), printer)
            if isinstance(verdict, Refusal):
                raise BadRequestError(
                    f"macro {macro.name!r}, line {number}: {verdict.message}; take it out"
                )

    def _write(self, profile: str, macros: list[Macro]) -> MacroFile:
        kept = MacroFile(macros=tuple(macros))
        data = yaml.safe_dump(kept.model_dump(mode="json"), sort_keys=False, allow_unicode=True)
        write_text(self._path(profile), data)
        return kept

    def _path(self, profile: str) -> Path:
        self._service.store.given(Printer, profile)  # refuses what is no profile's name
        return self._service.core.workspace.private / "macros" / f"{profile}.yaml"
