"""Client of an inspection hold (look): send lines to insert, or the decision that ends the hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from printctl.machine.control.look_book import LookDecision
from printctl.machine.errors import LinkError, Refused
from printctl.machine.process.connection import Connection

_PATIENCE_S: Final = 60.0
"""For an answer: the thread that speaks to the printer may be waiting for a step to end."""


@dataclass(frozen=True)
class LookClient:
    """Speaks to a print's link process.

    Attributes
    ----------
    connection : Connection
    """

    connection: Connection

    def insert(
        self,
        look: int,
        lines: Sequence[str],
        why: str = "",
        flow: float | None = None,
        again: bool = False,
    ) -> dict[str, Any]:
        """Put lines into the job where the print is held for a look.

        Parameters
        ----------
        look : int
            Number of the look (`Status.look`).
        lines : sequence of str
            One command each; they must end where the print is held.
        why : str
            For the journal.
        flow : float, optional
            What the job's moves that write push from there on, by what the file says: 1.1 for a
            tenth more. ``lines`` may be empty with it.
        again : bool
            Another look is made once the lines are written.

        Returns
        -------
        dict
            ``look``, ``after`` (lines of the job before them), ``count``, ``sha256``, ``flow``. The
            same insert again gives the same answer.

        Raises
        ------
        Refused
            With the reason: the gate's, no such look, or a second, different insert.
        LinkError
            When the print ends first.
        """
        self.connection.send(
            "insert", look=look, lines=list(lines), why=why, flow=flow, again=again
        )
        return self._answer("inserted", look)

    def decide(
        self, look: int, decision: LookDecision, why: str = "", again: bool = False
    ) -> dict[str, Any]:
        """End a look; return what is in the journal of it.

        With ``again`` it failed: after the pause it is made again, once at a place.

        Raises
        ------
        Refused
            When no such look is going on, or it was decided otherwise.
        LinkError
            When the print ends first.
        """
        self.connection.send("look_done", look=look, decision=str(decision), why=why, again=again)
        return self._answer("looked", look)

    def _answer(self, event: str, look: int) -> dict[str, Any]:
        for message in self.connection.messages(_PATIENCE_S):
            self.connection.take(message)
            if message["event"] == event and message["look"] == look:
                return message
            if message["event"] == "refused":
                raise Refused(message["message"])
        raise LinkError(f"no answer on look {look} within {_PATIENCE_S:g} s, or the print ended")
