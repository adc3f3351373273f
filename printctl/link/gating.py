"""Lines that a person types into a print: judged, and judged again when they are sent."""

from __future__ import annotations

from printctl.gate import Allowed, Refusal, Verdict
from printctl.link.errors import Refused


def let_through(verdict: Verdict) -> Allowed:
    """Return what was allowed.

    Raises
    ------
    Refused
        With the gate's reason.
    """
    if isinstance(verdict, Refusal):
        raise Refused(verdict.message)
    return verdict
