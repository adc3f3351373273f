"""Values of one look: what is looked at, what its pictures tell, and what mends it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from printctl.machine.job.marks import Mark, MarkKind
from printctl.observe.deciding import Evidence


@dataclass(frozen=True)
class Look:
    """A look that the link waits for.

    Attributes
    ----------
    number : int
    done : int
        Command lines of the growing job that were taken.
    job_line : int
        Command lines of the job's file among them.
    before : int
        The same at the look before.
    mark : str
    until_s : float, s of the monotonic clock
        By when its pictures are wanted, so that it is decided within the link's limit.
    """

    number: int
    done: int
    job_line: int
    before: int
    mark: str
    until_s: float = math.inf

    @property
    def within_vessel(self) -> bool:
        """Whether more of the vessel follows."""
        return self.mark.startswith(str(Mark(0, MarkKind.PART)))


@dataclass(frozen=True)
class Judged:
    """What the pictures of a look have told.

    Attributes
    ----------
    evidence : Evidence
    found : dict
        Figures for the record.
    flow : float
        Factor in force, as the job's inserts have it.
    learned : dict
        Of ink and scanner, for the records (`printctl.observe.learned`).
    """

    evidence: Evidence
    found: dict[str, Any]
    flow: float = 1.0
    learned: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class MendLines:
    """What mends the gaps and thin lines of a look.

    Attributes
    ----------
    lines : tuple of str
        None where nothing can be mended.
    left : str
        What isn't mended by them, and why; empty for nothing.
    left_mm : float, mm
    mended : tuple of dict
        Gaps that they write again (`printctl.observe.mends_again.Mended`), which are looked at
        once more.
    given_up : bool
        Whether a gap was written so often in vain that the operator alone has it written again.
    """

    lines: tuple[str, ...] = ()
    left: str = ""
    left_mm: float = 0.0
    mended: tuple[dict[str, Any], ...] = ()
    given_up: bool = False
