"""First contact with a firmware: its protocol, its board's boot, the numbers of its lines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from firmware_profiles import Printer
from firmware_profiles.families import LinkSetup
from firmware_profiles.families.link_protocol import LinkProtocol, Timing
from printctl.machine.control.channel import Channel
from printctl.machine.errors import HandshakeError
from printctl.machine.families import link_facts
from printctl.machine.job.care import Care
from printctl.machine.job.modal import places

BOOT_LISTEN_S: Final = 1.0
BOOT_QUIET_S: Final = 0.5
BOOT_LIMIT_S: Final = 10.0
CONNECT_LIMIT_S: Final = 15.0


def protocol_for(printer: Printer, quiet_s: float, care: Care | None = None) -> LinkProtocol:
    """Return a printer's protocol on a wire of so much latency (`Transport`).

    Its limits on silence and noise are those of ``care``.

    Raises
    ------
    Refused
        For a printer that takes no lines.
    """
    care = care or Care()
    facts = link_facts(printer)
    timing = Timing(quiet_s=quiet_s, noise_window=care.noise_window, noise_limit=care.noise_limit)
    if care.silent_limit_s is not None:
        seconds = care.silent_limit_s
        if facts.remembers:
            timing = replace(timing, silent_limit_s=seconds)
        else:
            timing = replace(timing, busy_limit_s=seconds)
    setup = LinkSetup(
        timing, printer.lines_in_flight, printer.receive_buffer_bytes, places, printer.withholds
    )
    return facts.make_protocol(setup)


def connect(channel: Channel, on_step: Callable[[], None] | None = None) -> None:
    """Have the printer number its lines from 0; ``on_step`` is the channel's meanwhile.

    Raises
    ------
    HandshakeError
        When no firmware answers.
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
        channel.listen(BOOT_QUIET_S)
