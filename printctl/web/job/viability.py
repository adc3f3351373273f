"""Compare the time since cells were mixed in with their limit and the print's remaining time."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from printctl.checks.set_up import Budget
from printctl.web.job.record import PrintRecord


@dataclass(frozen=True)
class Viability:
    """State of the cells' time limit.

    Attributes
    ----------
    minutes : float or None, min
        Since they were mixed; None where nobody said when.
    limit_min : float or None, min
        How long they have; None where nobody knows.
    source : str
        Who says so.
    words : str
        For the page.
    state : "unknown", "in time", "close", "late"
        ``late`` when the limit is passed, or will be before the print's end.
    """

    minutes: float | None
    limit_min: float | None
    source: str
    words: str
    state: Literal["unknown", "in time", "close", "late"]

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)


def viability(
    record: PrintRecord, budget: Budget | None, now: float, remaining_s: float | None
) -> Viability:
    """Tell it.

    Parameters
    ----------
    record : PrintRecord
    budget : Budget or None
        Of the ink or the form; what the record says comes first.
    now : float
        Wall-clock time, s since 1970.
    remaining_s : float or None, s
        Of the print; None when none goes on.
    """
    limit = record.viability_min or (budget.minutes if budget else None)
    source = "the record" if record.viability_min else budget.source if budget else ""
    if record.mixed_at is None:
        text = "Nobody said when cells and ink were mixed; note it in the record."
        return Viability(None, limit, source, text, "unknown")
    minutes = (now - record.mixed_at) / 60.0
    if limit is None:
        text = f"{minutes:.0f} min since mixing; how long the cells have isn't known."
        return Viability(minutes, None, "", text, "unknown")
    of = f"{minutes:.0f} of {limit:.0f} min since mixing ({source})"
    end = minutes + (remaining_s or 0.0) / 60.0
    if minutes > limit:
        return Viability(
            minutes, limit, source, f"{of}: {minutes - limit:.0f} min too long already.", "late"
        )
    if end > limit:
        late = f"{of}: the print is expected to end after {end:.0f} min, too late."
        return Viability(minutes, limit, source, late, "late")
    close = end > 0.9 * limit
    return Viability(
        minutes,
        limit,
        source,
        f"{of}; {limit - end:.0f} min to spare{', which is close' if close else ''}.",
        "close" if close else "in time",
    )
