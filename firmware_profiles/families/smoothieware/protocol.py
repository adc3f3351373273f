"""Smoothieware's link protocol: Marlin's with different replies; untested on hardware.

Facts (Smoothieware `GcodeDispatch.cpp`): lines are numbered and checked as in Marlin. What is out
of order (a repeat too) or fails its checksum is answered by ``rs N<next>`` alone: no error, no
ok, nothing thrown away. So the question is asked twice in a row, and two answers must agree. The
``ok`` to a G1 comes before the move is planned; a halted firmware answers ``!!`` until M999; ^X
halts it out of band. It has no command that says a text of one's own, so the answer to M115 stands
for a token; of two on their way the first is taken for the second. Unknown commands are answered
by ok: nobody learns of them. A line whose ``*`` is garbled away is taken unchecked: use USB, not
a UART.
"""

from __future__ import annotations

from firmware_profiles.families.known_messages import load_messages
from firmware_profiles.families.marlin.doubt import QUESTION
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.marlin.replies import Kind, Reply, classify
from firmware_profiles.families.marlin.state import Wording
from firmware_profiles.families.marlin.tokens import Tokens


def _classify(text: bytes) -> Reply:
    if text.startswith(b"Smoothie"):
        return Reply(Kind.START, text)
    return classify(text, load_messages("smoothieware", "marlin"))


class _Identity(Tokens):
    """Tokens that are answered by who the firmware is."""

    def make(self, number: int, now: float) -> bytes:
        """Command of a new token, for line ``number``."""
        super().make(number, now)
        return b"M115"

    def hear(self, text: bytes) -> bool:
        """Whether a line from the printer is the answer to one."""
        return b"FIRMWARE_NAME" in text and self.come_back()


class SmoothieProtocol(MarlinProtocol):
    """See the module."""

    kill_bytes: bytes = b"\x18\nM112\n"
    wording: Wording = Wording(
        question=QUESTION + QUESTION,
        classify=_classify,
        two_resends=True,
        make_tokens=_Identity,
        guard=bytes,  # it reads no raw bytes but ^X
    )
