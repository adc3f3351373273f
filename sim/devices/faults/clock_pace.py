"""Map a simulated board's clock to the host's clock; planned faults slow or freeze it."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class _Stretch:
    """From a moment on, the board's clock runs at a share of the host's."""

    host_s: float
    board_s: float
    share: float


class Pace:
    """Both clocks start at 0; between two faults they run in proportion.

    Parameters
    ----------
    share : float
        Board's seconds in one of the host's.
    """

    def __init__(self, share: float = 1.0) -> None:
        self._stretches = [_Stretch(0.0, 0.0, share)]

    def set_share(self, board_s: float, share: float) -> None:
        """From ``board_s`` on, s, run at a share of the host's clock."""
        self._stretches.append(_Stretch(self.host_time(board_s), board_s, share))

    def freeze(self, board_s: float, seconds: float) -> None:
        """Stand still at ``board_s``, s, for so long of the host's time."""
        last = self._stretches[-1]
        begins = _Stretch(self.host_time(board_s), board_s, 0.0)
        goes_on = replace(last, host_s=begins.host_s + seconds, board_s=board_s)
        self._stretches += [begins, goes_on]

    def board_time(self, host_s: float) -> float:
        """What the board's clock shows at a moment of the host's, s."""
        past = [one for one in self._stretches if one.host_s <= host_s]
        at = past[-1] if past else self._stretches[0]
        return at.board_s + (host_s - at.host_s) * at.share

    def host_time(self, board_s: float) -> float:
        """When, on the host's clock, the board's shows this first after a fault, s."""
        past = [one for one in self._stretches if one.board_s <= board_s and one.share > 0]
        at = past[-1] if past else self._stretches[0]
        return at.host_s + (board_s - at.board_s) / at.share
