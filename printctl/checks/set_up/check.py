"""Record of a preflight check (limit, value, passed); raise an exception for failed ones."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from typing import Any, Literal

from printctl.errors import SafetyError


@dataclass(frozen=True)
class Check:
    """A question asked of the G-code or the set-up, and its answer.

    Attributes
    ----------
    check : str
        What was looked at.
    value, limit : float
        What was found and what is allowed, in `unit`.
    unit : str
        Of both.
    passed : bool
        Whether the print may go on.
    place : str
        Line of the G-code or key of the profile; empty when it has none.
    remedy : str
        What to do when it didn't pass.
    weight : "refuses" or "warns"
        Whether a print may go on that didn't pass: ``warns`` where no machine can know, or where
        the number it rests on was never measured.
    """

    check: str
    value: float
    limit: float
    unit: str
    passed: bool
    place: str = ""
    remedy: str = ""
    weight: Literal["refuses", "warns"] = "refuses"

    @property
    def refuses(self) -> bool:
        """Whether no print may begin."""
        return not self.passed and self.weight == "refuses"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return asdict(self)

    def sentence(self) -> str:
        """For the user, when it didn't pass."""
        where = f" ({self.place})" if self.place else ""
        if self.value == self.limit == 0:  # asked of a person; there is nothing to compare
            return f"{self.check}{where}: {self.remedy}"
        value = f"{self.value:g} {self.unit}".rstrip()
        return f"{self.check}: {value}, limit {self.limit:g}{where}; {self.remedy}"

    def row(self) -> str:
        """One line of a table for people."""
        mark = "ok  " if self.passed else "FAIL" if self.refuses else "WARN"
        return f"{mark} {self.check:<52} {self.value:10.4g} {self.unit:<6} limit {self.limit:g}"


def warnings(checks: list[Check]) -> list[str]:
    """What a person must know before the print begins."""
    return [check.sentence() for check in checks if not check.passed and not check.refuses]


def placed_failures(checks: list[Check]) -> tuple[tuple[int, str], ...]:
    """Line of the G-code (0 for none) and sentence of each check that didn't pass."""
    failed = [check for check in checks if not check.passed]
    lines = [re.search(r"\bline (\d+)", check.place) for check in failed]
    return tuple(
        (int(line[1]) if line else 0, check.sentence())
        for line, check in zip(lines, failed, strict=True)
    )


def refusal_of(checks: list[Check]) -> SafetyError | None:
    """Return the error that names every check that didn't pass; None where all did."""
    failed = [check.sentence() for check in checks if check.refuses]
    if not failed:
        return None
    return SafetyError("\n".join(["refused before the first byte was sent:", *failed]))


def refuse_failed(checks: list[Check]) -> None:
    """Raise `SafetyError` naming every check that didn't pass."""
    if (refusal := refusal_of(checks)) is not None:
        raise refusal
