"""Thread-safe intake of inspection-hold requests: answer repeated ones, queue new ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from printctl.machine.control.logbook import Logbook
from printctl.machine.control.look_book import Answer, LookBook, LookDecision, LookWord
from printctl.machine.control.requests import RequestQueue
from printctl.machine.errors import Refused


class LookRequests:
    """Takes what clients say of looks, from any thread.

    Parameters
    ----------
    logbook : Logbook
    queue : RequestQueue
    book : LookBook
    """

    def __init__(self, logbook: Logbook, queue: RequestQueue, book: LookBook) -> None:
        self._logbook, self._queue, self._book = logbook, queue, book

    def insert(
        self,
        look: int,
        lines: Sequence[str],
        why: str,
        done: Callable[[Answer], None],
        refused: Callable[[str], None],
        flow: float | None = None,
        again: bool = False,
    ) -> None:
        """Ask for lines to be put into the job where the print is held.

        Parameters
        ----------
        look : int
            Number of the look, as the status tells it.
        lines : sequence of str
            One command each.
        why : str
            For the journal.
        done, refused : callable
            Told the answer once the lines are in the journal, or why they aren't.
        flow : float, optional
            What the job's moves that write push from there on, by what the file says.
        again : bool
            Another look is made once the lines are written.

        Raises
        ------
        Refused
            For another look than the one that is going on, or for a second, different insert.
        """
        self._say(LookWord(look, tuple(lines), None, why, done, refused, flow, again))

    def decide(
        self,
        look: int,
        decision: LookDecision,
        why: str,
        done: Callable[[Answer], None],
        refused: Callable[[str], None],
        again: bool = False,
    ) -> None:
        """Ask for a look to end; see `insert` for ``done`` and ``refused``.

        With ``again`` it failed, and is made again when the print goes on.

        Raises
        ------
        Refused
            For another look than the one that is going on, or where it was decided otherwise.
        """
        self._say(LookWord(look, (), decision, why, done, refused, again=again))

    def _say(self, word: LookWord) -> None:
        if self._logbook.status.ended:
            raise Refused("the print has ended")
        answer = self._book.answer(word)
        if answer is not None:
            word.done(answer)
        else:
            self._queue.add_look(word)
