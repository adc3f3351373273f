"""First contact with a firmware: wait for the board to boot, reset line numbering."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from printctl.machine.control.channel import Channel
from printctl.machine.errors import HandshakeError

BOOT_LISTEN_S: Final = 1.0
BOOT_QUIET_S: Final = 0.5
BOOT_LIMIT_S: Final = 10.0
CONNECT_LIMIT_S: Final = 15.0


def connect(channel: Channel, on_step: Callable[[], None] | None = None) -> None:
    """Have the printer number its lines from 0; ``on_step`` is the channel's meanwhile.

    Raises
    ------
    HandshakeError
        When nobody answers.
    """
    wiring = channel.wiring
    if wiring.fresh and wiring.printer.resets_on_connect:
        _await_boot(channel)
    limit = wiring.clock.now() + CONNECT_LIMIT_S
    channel.on_step = on_step
    while True:
        try:
            channel.agree(wiring.protocol.renumber)
        except HandshakeError:  # some boards sit in their boot loader for long
            if wiring.clock.now() > limit:
                raise
        else:
            channel.on_step = None
            return


def _await_boot(channel: Channel) -> None:
    """Give a board that resets when the port opens the time to say so, and to wake up."""
    clock, heard = channel.wiring.clock, channel.heard
    listen_until = clock.now() + BOOT_LISTEN_S
    while clock.now() < listen_until and not heard.booted:
        channel.pump(listen_until)
    limit, count = clock.now() + BOOT_LIMIT_S, -1
    while heard.booted and count != heard.count and clock.now() < limit:
        count = heard.count
        until = clock.now() + BOOT_QUIET_S
        while clock.now() < until:
            channel.pump(until)
