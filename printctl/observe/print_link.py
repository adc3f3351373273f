"""Requests of an observer to a print's link process."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class PrintLink(Protocol):
    """What the observer asks of a print's link."""

    def insert(
        self,
        look: int,
        lines: Sequence[str],
        why: str,
        flow: float | None = None,
        again: bool = False,
    ) -> object:
        """Put lines into the job where it is held, and correct the flow of its rest.

        With ``again`` another look is made once they are written.
        """

    def look_done(self, look: int, decision: str, why: str, again: bool = False) -> None:
        """End a look: ``go_on``, ``pause`` or ``stop``; ``again`` where it failed."""

    def resume(self) -> None:
        """Go on after a pause."""

    def stop(self) -> None:
        """Stop the print."""
