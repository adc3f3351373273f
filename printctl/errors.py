"""Errors of the printctl package, and the exit code of each.

::

    PrintctlError              exit 1
    ├── RecipeError            exit 2   the recipe is wrong: key path, value, limit, remedy
    ├── UsageError             exit 2   the command line is wrong
    ├── SafetyError            exit 3   a check refused; nothing was sent
    └── PrinterFailedError     exit 4   the printer failed, or was stopped
"""

from __future__ import annotations

from collections.abc import Iterable


class PrintctlError(Exception):
    """Something failed; the message says what and what to do."""

    exit_code = 1


class RecipeError(PrintctlError):
    """The recipe can't be used."""

    exit_code = 2


class UsageError(PrintctlError):
    """The command was called wrongly."""

    exit_code = 2


class SafetyError(PrintctlError):
    """A safety check refused to go on.

    Attributes
    ----------
    kinds : tuple of str
        Kinds of the checks that refused (`printctl.checks.kinds`), where checks did.
    """

    exit_code = 3

    def __init__(self, message: str = "", kinds: Iterable[str] = ()) -> None:
        super().__init__(message)
        self.kinds = tuple(kinds)


class PrinterFailedError(PrintctlError):
    """The print didn't end as it should."""

    exit_code = 4
