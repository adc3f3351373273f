"""Store, check and run macros: named lists of G-code commands, per printer profile."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Annotated, Final

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from design.files import write_text
from firmware_profiles import Printer, load
from firmware_profiles.yaml_file import read_yaml
from printctl.checks.gate import Refusal, judge_stored_line
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.printer.console import Console, checked_line
from printctl.web.printer.printer_access import PrinterAccess
from printctl.web.profile_store import ProfileStore

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
