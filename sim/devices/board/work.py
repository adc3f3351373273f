"""Command queue of a simulated board: waiting commands, and the one being executed."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from sim.devices.board.waits import Task, Wait


@dataclass
class BoardWork:
    """See the module.

    Attributes
    ----------
    queue : deque of bytes
        Lines that were taken; the first is in hand where there are tasks.
    tasks : list of (Task, Wait, bool)
        What is waited for, the newest last, and whether its end answers the command in hand.
    line : bytes
        The command in hand, or the last one.
    job_line : int
        Its place in the file that is printed; -1 for a host's own.
    answered : bool
        Whether it has its ok.
    mute : bool
        Whether the next ok is lost.
    busy_at : float, s
        When the firmware next says that it is busy.
    """

    queue: deque[bytes] = field(default_factory=deque)
    tasks: list[tuple[Task, Wait, bool]] = field(default_factory=list)
    line: bytes = b""
    job_line: int = -1
    answered: bool = False
    mute: bool = False
    busy_at: float = math.inf

    @property
    def idle(self) -> bool:
        """Whether no command is in line or in hand."""
        return not self.tasks and not self.queue

    def forget(self) -> None:
        """Drop everything, as a reset or a kill does."""
        self.queue.clear()
        self.tasks.clear()
        self.mute = False
        self.busy_at = math.inf
