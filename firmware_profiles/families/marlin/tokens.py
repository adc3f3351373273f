"""Make and recognise M118 texts that Marlin echoes once it has processed all earlier lines.

An ``ok`` doesn't say which line it answers, and may come at any later time. So after a doubt no ok
is believed until a token (``M118 E1 at 33.2``) has come back: commands are carried out in the order
in which they were taken, and each is answered before the next begins. What comes before the echo
answers earlier lines; the first ok behind it is the token's own.

A tail of the line that is run unchecked says its checksum too, and is no echo. A firmware without
M118 quotes the command that it doesn't know, which is as good.
"""

from __future__ import annotations

import math
from typing import Final

from firmware_profiles.families.marlin.replies import classify

COMMAND: Final = b"M118 E1 "
MOST: Final = 2
"""Tokens that wait for their echo: with the line before them, fewer than a command queue holds."""
PATIENCE_S: Final = 20.0
"""Longest wait for the ok behind an echo."""
MOST_DOUBLINGS: Final = 8
TRIES: Final = 60
"""So many tokens that don't come back, though they are taken: the firmware has no such command."""
_GARBLED: Final = 2
IDLE_S: Final = 20.0
"""Without a busy message for so long nothing is being worked on: the echo was lost."""


class Tokens:
    """Which tokens were sent, and which oks were heard meanwhile.

    Attributes
    ----------
    suspect : bool
        Whether an ok may belong to an earlier line than the one in flight.
    flying : bool
        Whether the line in flight is a token.
    echoed : bool
        Whether the newest has come back.
    owed, heard : float
        Oks that are due from lines taken since the doubt began, and those that came.
    numbers : set of int
        Lines that were tokens.
    sent_s : float, s
        When the newest left.
    tries : int
        Tokens sent since oks were last believed.
    doubted : bool
        Whether there was a doubt since oks were last believed: noise may have made lines.
    behind : bool
        Whether oks are due that come behind the newest token's own.
    """

    def __init__(self) -> None:
        self.suspect = self.flying = self.echoed = self.behind = self.doubted = False
        self.owed = self.heard = 0.0
        self.numbers: set[int] = set()
        self.sent_s = 0.0
        self._active_at = -math.inf
        self._moved_on = False
        self.tries = self._count = self._late = 0
        self._texts: list[bytes] = []

    def doubt(self) -> None:
        """Believe no ok from now on."""
        self.suspect = self.doubted = True

    def expect(self, oks: int) -> None:
        """Take notice of commands without numbers, each of which is answered by an ok."""
        self.suspect = True
        self.behind = self.flying
        self.owed += oks

    def forget_oks(self) -> None:
        """Nobody knows how many oks are due: what noise made of lines may be answered as well."""
        self.owed, self.heard = math.inf, 0.0

    def make(self, number: int, now: float) -> bytes:
        """Command of a new token, for line ``number``."""
        self._count += 1
        self.tries += 1
        self._late += self.flying and self.echoed
        text = b"at %d.%d" % (number, self._count)
        self._texts.append(text)
        self.suspect = self.flying = True
        self.behind = False
        self.echoed, self.sent_s, self._active_at = False, now, now
        self._moved_on = False
        return COMMAND + text

    def hear(self, text: bytes) -> bool:
        """Whether a line from the printer is the echo of a token; the newest is noted."""
        echo = text.removeprefix(b"echo:")
        for k, token in enumerate(self._texts):
            if echo == token or _quotes(text, token):
                self.echoed |= k == len(self._texts) - 1
                del self._texts[: k + 1]
                return True
        return False

    def quoted_by(self, text: bytes) -> bool:
        """Whether an unknown-command reply is to a token: there is no M118 in this firmware."""
        return any(token in text for token in self._texts)

    def resembles(self, text: bytes) -> bool:
        """Whether a line from the printer may be an echo that noise has garbled."""
        return any(
            _alike(text, form) for token in self._texts for form in (token, b"echo:" + token)
        )

    def move_on(self) -> None:
        """Something was answered since the newest left: there is room for one more."""
        self._moved_on = True

    def busy(self, now: float) -> None:
        """The printer is working on a line."""
        self._active_at = now

    def waited(self, now: float) -> float:
        """Seconds since the newest token left or the printer was last busy."""
        return now - self._active_at

    def ok_wait_s(self, answer_s: float) -> float:
        """Seconds to wait for the ok behind an echo: twice as long after each that was later."""
        return min(answer_s * 2.0 ** min(self._late, MOST_DOUBLINGS), PATIENCE_S)

    def may_send(self, now: float, keepalive: bool) -> bool:
        """Whether one more may be sent while those before it haven't come back.

        They may all wait behind a long move, and the command queue has four places.
        """
        idle = keepalive and now - self._active_at > IDLE_S
        return self.echoed or self._moved_on or len(self._texts) < MOST or idle

    def drop(self) -> None:
        """The token in flight wasn't taken."""
        self.flying = False
        if self._texts and not self.echoed:
            self._texts.pop()

    def settle(self) -> int:
        """The newest was answered: trust oks again; return how many more came than were due."""
        surplus = int(max(self.heard - self.owed, 0.0))
        self.suspect = self.flying = self.echoed = self.doubted = False
        self.owed = self.heard = 0.0
        self.tries, self._late = 0, max(self._late - 1, 0)
        self._texts.clear()
        return surplus


def _alike(text: bytes, token: bytes) -> bool:
    """Whether all but `_GARBLED` bytes of ``said`` begin or end a text of about its length."""
    if abs(len(text) - len(token)) > _GARBLED:
        return False
    begin = _alike_from_start(text, token)
    end = _alike_from_start(text[begin:][::-1], token[begin:][::-1])
    return begin + end >= len(token) - _GARBLED


def _alike_from_start(one: bytes, other: bytes) -> int:
    pairs = enumerate(zip(one, other, strict=False))
    return next((k for k, (a, b) in pairs if a != b), min(len(one), len(other)))


def _quotes(text: bytes, token: bytes) -> bool:
    command = classify(text).quoted
    return command.endswith(b" " + token) and command[:1] == b"M"
