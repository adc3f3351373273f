"""Check firmware, steps per mm, heads; set modes a job relies on; restore settings afterwards."""

from __future__ import annotations

import re
from typing import Final

from firmware_profiles.families import family_of
from printctl.machine.control.channel import Channel
from printctl.machine.control.gating import settings_changed_by
from printctl.machine.control.gauges import Gauges
from printctl.machine.control.position_check import RETRIES
from printctl.machine.control.start_checks import agree_settings
from printctl.machine.errors import HandshakeError
from printctl.machine.families import link_facts
from printctl.machine.job.dispensing import shut
from printctl.machine.job.firmware import Firmware, differences, mode_lines, parse_firmware

_TARGET: Final = re.compile(rb":-?[0-9.]+ */([0-9.]+)")
"""Of each heater, as M105 tells it, °C."""


class FirmwareCheck:
    """Compares one firmware with the profile, and keeps what it says of itself.

    Parameters
    ----------
    channel : Channel
    gauges : Gauges

    Attributes
    ----------
    firmware : Firmware
        What M115 was answered with; empty before.
    """

    def __init__(self, channel: Channel, gauges: Gauges) -> None:
        self._channel, self._gauges = channel, gauges
        self._wiring, self._logbook = channel.wiring, channel.logbook
        self._printer = channel.wiring.printer
        self._settings: dict[str, str] = {}
        self.firmware = Firmware()

    def check(self) -> None:
        """Ask the firmware what it is; set what the job counts on.

        Raises
        ------
        HandshakeError
            For a difference that would make distances, doses or heads wrong.
        """
        family = link_facts(self._printer)
        self._identify(family.reported_name)
        self._check_heads()
        self.check_keepalive(journalled=False)
        if family.tells_steps:
            self.check_steps(journalled=False)
        else:
            self._logbook.notice("this firmware doesn't tell its steps per mm (M92)")
        self.agree_settings(journalled=False)
        # an earlier job may have left these otherwise
        for command in shut(self._printer):
            self._channel.ask(command)
        self.set_modes(journalled=False)
        self._gauges.check_at_rest()
        self._logbook.excuse("")  # a firmware without M113 says so; that is no fault of the job

    def _identify(self, says: str) -> None:
        for _ in range(RETRIES):
            self.firmware = parse_firmware(self._channel.ask(b"M115"))
            self._channel.kill.learn(self.firmware)
            if self.firmware.is_a(says):
                return
        name = self.firmware.name or "nothing"
        raise HandshakeError(
            f"{self._wiring.transport.name} answers M115 with {name!r}, the profile expects "
            f"{self._printer.firmware}; choose the profile of this printer"
        )

    def _check_heads(self) -> None:
        """Refuse a firmware that was built for fewer heads: it would push one syringe for all."""
        built, wanted = self.firmware.extruders, len(self._printer.heads)
        if 0 < built < wanted:
            raise HandshakeError(
                f"the firmware was built for {built} (EXTRUDER_COUNT), the profile names {wanted} "
                "heads: it would go on with one where the job takes another; build it with "
                f"EXTRUDERS {wanted}, or choose the profile of this printer"
            )

    def check_keepalive(self, journalled: bool) -> None:
        """Have the firmware say every second that it is busy, and see that it will."""
        protocol = self._wiring.protocol
        if not link_facts(self._printer).keepalive:
            protocol.keepalive = False
            return
        for _ in range(RETRIES):
            self._channel.command(b"M113 S1", journalled)
            answer = self._channel.command(b"M113", journalled)
            if any(b"M113 S1" in text for text in answer):
                return
        protocol.keepalive = False
        self._logbook.alarm("the firmware sends no busy messages (M113); a lost ok costs a minute")

    def check_steps(self, journalled: bool) -> None:
        """Refuse a printer whose steps per mm aren't the profile's; note other differences.

        Raises
        ------
        HandshakeError
        """
        off: list[str] = []
        for _ in range(RETRIES):
            off = differences(
                self.firmware, self._channel.command(b"M92", journalled), self._printer
            )
            if not any("steps/mm" in text for text in off):
                break
        for text in off:
            if "steps/mm" in text:
                raise HandshakeError(
                    f"{text}: distances or doses would be wrong; set the firmware (M92, M500) or "
                    "correct the profile"
                )
            self._logbook.alarm(text)

    def set_modes(self, journalled: bool) -> None:
        """Set what a job takes for granted: mm, absolute places, an absolute plunger."""
        for mode in mode_lines(self._printer):
            self._channel.command(mode, journalled)

    # --- settings that a job may change ----------------------------------------------------------

    def agree_settings(self, journalled: bool) -> None:
        """Have the firmware as checks count on; write down what a job may change."""

        def ask(text: bytes) -> tuple[bytes, ...]:
            return self._channel.command(text, journalled)

        before = self._logbook.fault
        settings = agree_settings(ask, self._printer, self._logbook.alarm, self._logbook.begun)
        self._logbook.excuse(before)  # a question that this build doesn't know
        self._logbook.record("settings", told=settings)
        self._settings = self._settings or settings

    def restore_settings(self, settings: dict[str, str]) -> None:
        """Take the settings as they were before the job, from its journal."""
        self._settings = settings

    def undo_settings(self) -> None:
        """Set the firmware's settings as they were before the job, where it has changed them.

        Where it had no switch-off of its own, the job's stays while a heater is on: nothing else
        would switch that off, once this process has ended.
        """
        for code in settings_changed_by(self._logbook.progress.taken, self._printer):
            before = self._settings.get(code, "")
            if before and self._ends_switch_off(before) and self._heats():
                self._logbook.alarm(
                    f"a heater is on, so the firmware's own switch-off stays as the job set it "
                    f"({code}); {before} takes it back"
                )
            elif before:
                self._channel.command(before.encode("ascii"))

    def _ends_switch_off(self, command: str) -> bool:
        """Whether with this command the firmware would never switch off by itself."""
        family = family_of(self._printer)
        return bool(family.timeout_code) and command == family.timeout_command("0")

    def _heats(self) -> bool:
        """Whether a heater has a target."""
        answer = self._channel.command(b"M105")
        return any(float(target) for text in answer for target in _TARGET.findall(text))
