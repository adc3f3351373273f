"""Find profiles (printers, syringes, inks…) by name: the workspace's own, then those shipped."""

from __future__ import annotations

import contextlib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from firmware_profiles import PROFILE_SORTS, Facts, Printer, ProfileError, load, shipped
from firmware_profiles.load import FOLDERS, Profile
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.workspace import checked_name, is_name

PARTS: Final[dict[str, type[Facts]]] = {
    sort: PROFILE_SORTS[sort] for sort in ("needle", "syringe", "ink", "bath", "dish")
}
"""What can be mounted on a printer."""


@dataclass(frozen=True)
class ProfileStore:
    """Profiles by name; those of the workspace ``root`` are in ``profiles/SORT/NAME.yaml``."""

    root: Path

    def folder(self, model: type[Facts]) -> Path:
        """Where the workspace's own profiles of a sort are."""
        return self.root / "profiles" / FOLDERS[model]

    def names(self, model: type[Facts]) -> list[str]:
        """The workspace's own first, then those shipped."""
        own = sorted(p.stem for p in self.folder(model).glob("*.yaml") if is_name(p.stem))
        return [*own, *(name for name in shipped(model) if name not in own)]

    def given(self, model: type[Facts], name: str) -> str:
        """What `firmware_profiles.load` takes: a shipped name, or the path of one's own.

        Raises
        ------
        NotFoundError
        """
        own = self.folder(model) / f"{checked_name(name)}.yaml"
        if own.is_file():
            return str(own.resolve())
        if name not in shipped(model):
            raise NotFoundError(
                f"there is no {FOLDERS[model][:-1]} profile {name!r}; there are "
                f"{', '.join(self.names(model))}"
            )
        return name

    def resolve(self, model: type[Facts], value: str, used: Collection[str] = ()) -> str:
        """Return what `given` gives of a name; a file of the workspace, or one ``used``, as it is.

        Parameters
        ----------
        model : type of Facts
        value : str
            Name, or path of a file, as a client or a recipe says it.
        used : collection of str
            What the printer's station uses, whatever files these are.

        Raises
        ------
        NotFoundError
            For a name that no profile has.
        BadRequestError
            For any other file: the page isn't for reading the machine's files.
        """
        if value in used:
            return value
        if not (value.endswith((".yaml", ".yml")) or {"/", "\\"}.intersection(value)):
            return self.given(model, value)
        path = Path(value).resolve()
        if not path.is_relative_to(self.root.resolve()):
            raise BadRequestError(
                f"{FOLDERS[model][:-1]} {value[:80]!r} is a file outside the workspace "
                f"{self.root}; give a profile's name, or put the file into "
                f"{self.folder(model)}"
            )
        return str(path)

    def choices(self, model: type[Facts]) -> dict[str, str]:
        """What `given` gives of every name, to the name."""
        return {self.given(model, name): name for name in self.names(model)}

    def load(self, model: type[Profile], name: str) -> Profile:
        """Load a profile by its name; see `given` and `firmware_profiles.load`."""
        return load(model, self.given(model, name))

    @staticmethod
    def name(given: str) -> str:
        """The name of what `given` gave."""
        return Path(given).stem if given.endswith((".yaml", ".yml")) else given

    def new_file(self, model: type[Facts], name: str) -> Path:
        """Where a measured copy goes.

        Raises
        ------
        ConflictError
            When a shipped profile has that name.
        """
        if checked_name(name) in shipped(model):
            raise ConflictError(
                f"{name!r} is a shipped profile's name; give the measured copy another one"
            )
        return self.folder(model) / f"{name}.yaml"

    def printers(self) -> list[str]:
        """Names of printers that a host can stream to."""
        kept = []
        for name in self.names(Printer):
            with contextlib.suppress(ProfileError, OSError):  # one's own that can't be used
                if self.load(Printer, name).streamed:
                    kept.append(name)
        return kept
