"""Find a firmware family by name or printer profile, among the packages of this folder."""

from __future__ import annotations

import sys
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Protocol

from firmware_profiles.errors import ProfileError
from firmware_profiles.families.family import Family
from firmware_profiles.families.grammar import Meaning


class HasFirmware(Protocol):
    """A printer's profile, as far as it is asked for here."""

    @property
    def firmware(self) -> str:
        """Name of the family."""
        ...


def family_names() -> tuple[str, ...]:
    """Return the names of all families, in alphabetical order."""
    folders = sys.modules[__package__].__path__
    return tuple(sorted(module.name for module in iter_modules(folders) if module.ispkg))


@cache
def find_family(name: str) -> Family:
    """Return the family with a name.

    Raises
    ------
    ProfileError
        When there is none.
    """
    if name not in family_names():
        raise ProfileError(
            f"no firmware family is named {name!r}; there is: {', '.join(family_names())}"
        )
    family: Family = import_module(f"{__package__}.{name}").FAMILY
    return family


@cache
def meanings() -> dict[str, Meaning]:
    """Return what commands with names do, of all families together."""
    return {
        name: meaning
        for family in family_names()
        for name, meaning in find_family(family).grammar.names.items()
    }


def family_of(printer: HasFirmware) -> Family:
    """Return the family that a printer's profile names."""
    return find_family(printer.firmware)
