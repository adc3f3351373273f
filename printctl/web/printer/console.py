"""Console and macros of the printer."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from design.files import write_text
from firmware_profiles import Printer, load
from firmware_profiles.yaml_file import read_yaml
from printctl.checks.gate import Refusal, judge_stored_line
from printctl.machine.link.errors import LinkError
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError, WebError
from printctl.web.printer.printer_commands import PrinterAccess
from printctl.web.profile_store import ProfileStore

KEPT: Final = 500
LONGEST: Final = 200


@dataclass(frozen=True)
class Entry:
    """Entry of the console.

    Attributes
    ----------
    number : int
        Counts up.
    at_s : float, s since 1970
    who, text : str
    replies : tuple of str
    refused : str
        Why it wasn't sent, or failed; empty when it went out.
    """

    number: int
    at_s: float
    who: str
    text: str
    replies: tuple[str, ...] = ()
    refused: str = ""

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)


class Console:
    """Sends lines and keeps what came of them, the same for all browsers.

    Parameters
    ----------
    access : PrinterAccess
    clock : function
        Seconds since 1970.
    """

    def __init__(self, access: PrinterAccess, clock: Callable[[], float] = time.time) -> None:
        self._access, self._clock = access, clock
        self._entries: deque[Entry] = deque(maxlen=KEPT)
        self._count = 0
        self._lock = threading.Lock()

    def entries(self, after: int = 0) -> list[Entry]:
        """Those with a number above ``after``, oldest first."""
        with self._lock:
            return [entry for entry in self._entries if entry.number > after]

    def send(self, who: Principal, typed: str) -> list[str]:
        """Send a line; give the reply.

        Raises
        ------
        BadRequestError
            For no line, or more than one.
        NotInControlError, ConflictError, LinkError
        """
        text = checked_line(typed)
        try:
            replies = self._access.ask(who).command(text)
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
            entry = Entry(self._count, self._clock(), who.name, text, replies, refused)
            self._entries.append(entry)
        self._access.core.events.publish("console", **entry.to_dict())


def checked_line(typed: str) -> str:
    """One command as it can be sent.

    Raises
    ------
    BadRequestError
    """
    text = typed.strip()
    if not text or len(text) > LONGEST or not (text.isascii() and text.isprintable()):
        raise BadRequestError(
            f"{typed[:40]!r} isn't one command: 1 to {LONGEST} printable ASCII characters on one "
            "line"
        )
    return text


# Store, check and run macros: named lists of G-code commands, per printer profile.

MOST: Final = 50


class Macro(BaseModel):
    """Commands under a name.

    They are sent one after the other, as if typed into the console, until one is refused.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, Field(min_length=1, max_length=40, pattern=r"^\S.*$")]
    commands: Annotated[tuple[str, ...], Field(min_length=1, max_length=100)]


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    macros: Annotated[tuple[Macro, ...], Field(max_length=MOST)] = ()


class Macros:
    """Reads, checks, keeps and runs them.

    Parameters
    ----------
    access : PrinterAccess
    store : ProfileStore
    console : Console
    """

    def __init__(self, access: PrinterAccess, store: ProfileStore, console: Console) -> None:
        self._access, self._store, self._console = access, store, console
        self._lock = threading.Lock()

    def of(self, profile: str) -> list[Macro]:
        """Those of a printer profile.

        Raises
        ------
        ConflictError
            When their file can't be read.
        """
        path = self._path(profile)
        if not path.is_file():
            return []
        try:
            return list(_File.model_validate(read_yaml(path.read_text("utf-8"))).macros)
        except (yaml.YAMLError, UnicodeDecodeError, ValidationError) as exc:
            raise ConflictError(f"{path} holds no macros: {exc}; mend or remove it") from exc

    def save(self, who: Principal, profile: str, macro: Macro) -> None:
        """Keep a macro, in place of one of the same name.

        Raises
        ------
        BadRequestError
            For a command that the console would refuse.
        """
        self._access.core.controls.require(who)
        self._check(profile, macro)
        with self._lock:
            kept = [one for one in self.of(profile) if one.name != macro.name]
            if len(kept) >= MOST:
                raise ConflictError(f"there are {MOST} macros already; remove one first")
            self._write(profile, [*kept, macro])

    def remove(self, who: Principal, profile: str, name: str) -> None:
        """Forget a macro.

        Raises
        ------
        NotFoundError
        """
        self._access.core.controls.require(who)
        with self._lock:
            every = self.of(profile)
            kept = [one for one in every if one.name != name]
            if len(kept) == len(every):
                raise NotFoundError(f"{profile} has no macro {name!r}")
            self._write(profile, kept)

    def run(self, who: Principal, name: str) -> list[str]:
        """Send a macro's commands to the printer that is connected; give all replies.

        Raises
        ------
        NotFoundError
        LinkError
            When a command is refused; those after it aren't sent.
        """
        self._access.ask(who)
        profile = self._store.name(self._access.status.profile)
        named = [one for one in self.of(profile) if one.name == name]
        if not named:
            raise NotFoundError(f"{profile} has no macro {name!r}")
        self._check(profile, named[0])
        with self._access.moving(who):
            return [reply for text in named[0].commands for reply in self._console.send(who, text)]

    def _check(self, profile: str, macro: Macro) -> None:
        printer = load(Printer, self._store.given(Printer, profile))
        for number, text in enumerate(macro.commands, 1):
            verdict = judge_stored_line(checked_line(text), printer)
            if isinstance(verdict, Refusal):
                raise BadRequestError(
                    f"macro {macro.name!r}, line {number}: {verdict.message}; take it out"
                )

    def _write(self, profile: str, macros: list[Macro]) -> None:
        data = {"macros": [one.model_dump(mode="json") for one in macros]}
        write_text(self._path(profile), yaml.safe_dump(data, sort_keys=False, allow_unicode=True))

    def _path(self, profile: str) -> Path:
        self._store.given(Printer, profile)
        return self._access.core.workspace.private / "macros" / f"{profile}.yaml"
