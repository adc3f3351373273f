"""Keep the firmware from cutting motor power or timing out during pauses, dwells and heating."""

from __future__ import annotations

from firmware_profiles.families import family_of
from printctl.machine.control.channel import Channel
from printctl.machine.families import link_facts
from printctl.machine.job.coordinates import last_of


class IdleMotors:
    """Keeps one printer from switching off by itself.

    Parameters
    ----------
    channel : Channel
    """

    def __init__(self, channel: Channel) -> None:
        self._channel, self._progress = channel, channel.logbook.progress
        printer = channel.wiring.printer
        self._m84_sets_timeout = link_facts(printer).m84_sets_timeout
        code = family_of(printer).timeout_code
        self._timeouts = (code.encode("ascii"),) if code else ()

    def hold(self) -> None:
        """Keep the firmware from cutting the motors' power while nothing moves; before line 1.

        Without it Marlin cuts them two minutes into a dwell, or a wait for heat, of the job itself.
        No firmware tells the time that was in force, so that it isn't set back: they stay powered.
        """
        if self._m84_sets_timeout:
            self._channel.command(b"M84 S0", journalled=False)

    def sign_of_life(self) -> None:
        """Show that the printer is there, and begin its own switch-off time anew.

        Only moves and the command that sets that time begin it anew; M105 doesn't.
        """
        self._channel.command(self._last_of(self._timeouts) or b"M105")

    def _last_of(self, codes: tuple[bytes, ...]) -> bytes | None:
        return last_of(self._progress.job.lines, self._progress.done, codes)
