"""Fake Marlin that accepts lines immediately and executes them later.

As the real one: what it has taken waits in a queue of four, its ok comes when it is carried out,
and a line with a wrong number is answered at once, before all that. While the queue is full it
reads nothing.
"""

from __future__ import annotations

from collections import deque

from tests.printctl.machine.link.fake_marlin import FakeMarlin

QUEUE = 4


class QueueingMarlin(FakeMarlin):
    """`receive` takes lines, `work` carries them out."""

    def __init__(self, rng=None) -> None:
        super().__init__(rng)
        self.queue: deque[str] = deque()

    def receive(self, data: bytes) -> bytes:
        self._rest += data
        out = b""
        while b"\n" in self._rest and len(self.queue) < QUEUE:
            line, self._rest = self._rest.split(b"\n", 1)
            if line.strip() and not self.halted:
                out += self._take(line.decode("latin-1").strip())
        return out

    def work(self, count: int) -> bytes:
        """Carry out up to ``count`` commands; give the answers to them and to what is read then."""
        out = b""
        for _ in range(min(count, len(self.queue))):
            out += super()._do(self.queue.popleft())
        return out + self.receive(b"")

    def _do(self, command: str) -> bytes:
        self.queue.append(command)
        return b""
