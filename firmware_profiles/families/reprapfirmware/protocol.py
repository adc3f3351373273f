"""RepRapFirmware link protocol: CRC-16 lines, position asked after silence; untested on hardware.

Facts (RepRapFirmware `StringParser.cpp`, 3.x): with ``N`` in front a line is checked, by an XOR of
one to three digits or a CRC-16 of five; one that fails is dropped without a word, neither ok nor
resend; the order of numbers isn't looked at, so that a line sent twice is done twice. The line
number that M409 tells is stored before the check, so it is no evidence of what was done.

The five digits of the CRC-16 find what the XOR lets through. A line cut in two by noise is done
half by half, unless the board is told to want a checksum (M575 P0 S1); USB has a CRC of its own.
"""

from __future__ import annotations

from firmware_profiles.families.ack_protocol import AckProtocol, Sort
from firmware_profiles.families.known_messages import load_messages
from firmware_profiles.families.reprapfirmware.crc16 import crc16


class RrfProtocol(AckProtocol):
    """See the module."""

    messages = load_messages("reprapfirmware")
    error_starts = (b"Error:", b"Warning:", b"Emergency Stop", b"Printer halted")

    def frame(self, number: int, command: bytes) -> bytes:
        """``N<number> <command>*<CRC-16 in five digits>`` and line end."""
        body = b"N%d %b" % (number, command)
        return b"%b*%05d\n" % (body, crc16(body))

    def sort(self, text: bytes) -> Sort:
        """Tell what a line from the printer is."""
        return self.sort_known(text)
