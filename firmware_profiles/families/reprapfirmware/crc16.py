"""CRC-16 as RepRapFirmware checks it: polynomial 0x1021, start 0, no reflection (XMODEM)."""

from __future__ import annotations

from binascii import crc_hqx


def crc16(data: bytes) -> int:
    """CRC-16/XMODEM of ``data``; 0x31C3 for ``b"123456789"``."""
    return crc_hqx(data, 0)
