"""Time limits of a printer link's protocol, and the number of transmission errors it tolerates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

HOST_LATE_S: Final = 1.0
"""A deadline missed by more: the host slept, which is no silence of the printer."""


@dataclass(frozen=True)
class Timing:
    """Time limits and the limit on line errors.

    Attributes
    ----------
    silence_s : float
        Without any sign of life while a line is in flight, until the printer is asked. It decides
        nothing but how soon a lost ok is noticed.
    deaf_s : float
        Of a firmware that says nothing while it is busy: after so long, and then as often, a notice
        is given and it is asked.
    quiet_s : float
        Of silence that counts as "no reply is under way"; longer than a USB adapter's latency.
    whole_s : float
        For the second half of a line from the printer, before it is asked for a token.
    answer_s : float
        For the answer to a question, until it is asked again.
    doubt_limit_s : float
        Without a usable answer until a printer that isn't found yet counts as silent, and until
        an alarm is given of one in mid-print. An answer that is later than this was lost.
    silent_limit_s : float
        Without a usable answer until a printer in mid-print counts as silent.
    busy_limit_s : float
        For one line of a firmware that says nothing while it is busy.
    noise_window, noise_limit : int
        More than ``noise_limit`` lines sent again among ``noise_window``: the print pauses.
    calm_lines : int
        After a doubt so many lines leave one by one, where two may be in flight.
    """

    silence_s: float = 1.8
    deaf_s: float = 60.0
    quiet_s: float = 0.05
    whole_s: float = 0.2
    answer_s: float = 0.8
    doubt_limit_s: float = 6.0
    silent_limit_s: float = 60.0
    busy_limit_s: float = 1800.0
    noise_window: int = 500
    noise_limit: int = 30
    calm_lines: int = 200
