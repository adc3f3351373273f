"""Count failed password or token attempts per address; give the wait until the next one.

The package limits takes 84 ms to import, no clock of ours, and counts attempts, not failures.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

WINDOW_S: Final = 60.0
PER_ADDRESS: Final = 5
OVERALL: Final = 30
_ADDRESSES: Final = 10_000


@dataclass
class Throttle:
    """Counts attempts that failed, per address and overall, in the last minute."""

    clock: Callable[[], float] = time.monotonic
    _by_address: dict[str, deque[float]] = field(default_factory=dict)
    _all: deque[float] = field(default_factory=deque)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def wait_s(self, address: str) -> int:
        """Whole seconds until this address may try again; 0 for now."""
        with self._lock:
            mine = self._recent(self._by_address.get(address, deque()))
            waits = [0.0]
            if len(mine) >= PER_ADDRESS:
                waits.append(mine[-PER_ADDRESS] + WINDOW_S - self.clock())
            if len(self._recent(self._all)) >= OVERALL:
                waits.append(self._all[-OVERALL] + WINDOW_S - self.clock())
            return math.ceil(max(waits))

    def failed(self, address: str) -> None:
        """Note a wrong password."""
        with self._lock:
            if len(self._by_address) >= _ADDRESSES:
                self._by_address = {a: q for a, q in self._by_address.items() if self._recent(q)}
            now = self.clock()
            self._by_address.setdefault(address, deque(maxlen=PER_ADDRESS)).append(now)
            self._recent(self._all).append(now)

    def succeeded(self, address: str) -> None:
        """Forget an address's failures."""
        with self._lock:
            self._by_address.pop(address, None)

    def _recent(self, tries: deque[float]) -> deque[float]:
        while tries and self.clock() - tries[0] > WINDOW_S:
            tries.popleft()
        return tries
