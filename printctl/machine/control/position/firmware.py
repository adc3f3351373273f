"""Check firmware, steps per mm, heads; set modes a job relies on; restore settings afterwards."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from firmware_profiles import Printer
from firmware_profiles.families import family_of
from printctl.checks.gate.firmware import (
    Difference,
    blind_resets,
    panel_questions,
    questions,
    reported_settings,
)
from printctl.checks.gate.firmware import differences as setting_differences
from printctl.machine.control.board.channel import Channel
from printctl.machine.control.board.gauges import Gauge, check_at_rest
from printctl.machine.control.board.steps import Steps
from printctl.machine.control.gating import settings_changed_by
from printctl.machine.errors import HandshakeError
from printctl.machine.families import link_facts
from printctl.machine.job.dispensing import shut

RETRIES: Final = 8
"""So often a question is asked whose answer may be garbled."""
_TRIES: Final = 4
"""So often settings are reset that come back, or whose answers are garbled."""
_STEPS_WITHIN: Final = 0.006
"""Steps/mm: firmwares tell two decimals."""
_CAP: Final = re.compile(rb"Cap:(\w+):(\d)$")
_NAME: Final = re.compile(rb"FIRMWARE_NAME: ?(.*?)(?:,? [A-Z-]+_[A-Z_]+:.*|,? ELECTRONICS:.*)?$")
_EXTRUDERS: Final = re.compile(rb"EXTRUDER_COUNT:(\d+)")
_STEPS: Final = re.compile(rb"([XYZE]):? ?(\d+\.\d+)")
_TARGET: Final = re.compile(rb":-?[0-9.]+ */([0-9.]+)")
"""Of each heater, as M105 tells it, °C."""


@dataclass(frozen=True)
class Firmware:
    """Reply to M115."""

    name: str = ""  # FIRMWARE_NAME, which contains the family's, of forks too; empty for unread
    capabilities: dict[str, bool] = field(default_factory=dict)
    extruders: int = 0  # heads that it was built for (EXTRUDER_COUNT); 0 where it doesn't say


def parse_firmware(replies: Sequence[bytes]) -> Firmware:
    """Read the reply to M115."""
    name, extruders, capabilities = "", 0, {}
    for text in replies:
        if named := _NAME.search(text):
            name = named[1].decode("ascii", "replace")
            counted = _EXTRUDERS.search(text)
            extruders = int(counted[1]) if counted else 0
        elif match := _CAP.match(text):
            capabilities[match[1].decode()] = match[2] == b"1"
    return Firmware(name, capabilities, extruders)


def mode_lines(printer: Printer) -> tuple[bytes, ...]:
    """Return what a job relies on: mm, absolute places, and an absolute plunger if there is one.

    A Marlin without extruder doesn't know M82.
    """
    return (b"G21", b"G90") if printer.pneumatic else (b"G21", b"G90", b"M82")


class FirmwareCheck:
    """Compares one firmware with the profile, and keeps its settings from before the job."""

    def __init__(self, channel: Channel) -> None:
        self._channel, self._logbook = channel, channel.logbook
        self._printer = channel.wiring.printer
        self._settings: dict[str, str] = {}
        self.firmware = Firmware()

    def check(self, gauges: Sequence[Gauge]) -> Steps[None]:
        """Ask the firmware what it is; set what the job counts on; read gauges at rest.

        Raise `HandshakeError` for a difference that would make distances, doses or heads wrong.
        """
        yield from self._identify()
        if link_facts(self._printer).tells_steps:
            yield from self.check_steps(journalled=False)
        else:
            self._logbook.notice("this firmware doesn't report its steps per mm (M92)")
        yield from self.agree_settings(journalled=False)
        # an earlier job may have left these otherwise
        for command in shut(self._printer):
            yield from self._channel.ask(command)
        yield from self.set_modes(journalled=False)
        yield from check_at_rest(self._channel, gauges)
        self._logbook.excuse()  # a firmware without M113 says so; that is no fault of the job

    def _identify(self) -> Steps[None]:
        printer = self._printer
        for _ in range(RETRIES):
            self.firmware = parse_firmware((yield from self._channel.ask(b"M115")))
            self._channel.kill.learn(self.firmware.capabilities)
            if link_facts(printer).reported_name in self.firmware.name.lower():
                break
        else:
            raise HandshakeError(
                f"{self._channel.wiring.transport.name} replies to M115 with "
                f"{self.firmware.name or 'nothing'!r}, but the profile expects {printer.firmware}; "
                "select this printer's profile"
            )
        # for whoever halts it when this process has died
        self._logbook.record("firmware", capabilities=self.firmware.capabilities)
        built, wanted = self.firmware.extruders, printer.tool_count
        if wanted > 1 and 0 < built < wanted:  # it would push one syringe for all
            raise HandshakeError(
                f"the firmware was built for {built} (EXTRUDER_COUNT), the profile has {wanted} "
                "heads: it would keep using one where the job selects another; build it with "
                f"EXTRUDERS {wanted}, or select this printer's profile"
            )

    def check_keepalive(self, journalled: bool) -> Steps[None]:
        """Have the firmware say every second that it is busy, and see that it will."""
        protocol = self._channel.wiring.protocol
        if not link_facts(self._printer).keepalive:
            protocol.keepalive = False
            return
        for _ in range(RETRIES):
            yield from self._channel.command(b"M113 S1", journalled)
            answer = yield from self._channel.command(b"M113", journalled)
            if any(b"M113 S1" in text for text in answer):
                return
        protocol.keepalive = False
        self._logbook.alarm("the firmware sends no busy messages (M113); a lost ok costs a minute")

    def check_steps(self, journalled: bool) -> Steps[None]:
        """Refuse a printer whose steps per mm aren't the profile's; note another parser."""
        wrong = ""
        for _ in range(RETRIES):
            wrong = self._wrong_steps((yield from self._channel.command(b"M92", journalled)))
            if not wrong:
                break
        profiled = self._printer.emergency_parser
        parser = self.firmware.capabilities.get("EMERGENCY_PARSER", profiled)
        if parser != profiled:
            self._logbook.alarm(
                f"EMERGENCY_PARSER is {'on' if parser else 'off'} in the firmware, "
                f"{'on' if profiled else 'off'} in the profile"
            )
        if wrong:
            raise HandshakeError(
                f"{wrong}: distances or doses would be wrong; set the firmware (M92, M500) or "
                "correct the profile"
            )

    def _wrong_steps(self, replies: Sequence[bytes]) -> str:
        """Return the first axis whose steps differ from the profile's, by the reply to M92."""
        for text in replies:
            if b"M92" in text or text.startswith(b"Steps/mm:"):
                for axis, value in _STEPS.findall(text):
                    expected = getattr(self._printer.steps_per_mm, axis.decode().lower())
                    if abs(float(value) - expected) > _STEPS_WITHIN:
                        return (
                            f"{axis.decode()} has {float(value):g} steps/mm in the firmware, "
                            f"{expected:g} in the profile (steps_per_mm)"
                        )
        return ""

    def set_modes(self, journalled: bool) -> Steps[None]:
        """Set what a job takes for granted: mm, absolute places, an absolute plunger."""
        for mode in mode_lines(self._printer):
            yield from self._channel.command(mode, journalled)

    # --- settings that a job may change ----------------------------------------------------------

    def agree_settings(self, journalled: bool) -> Steps[None]:
        """Reset what the firmware has otherwise than checks count on; keep what a job may change.

        Raise `HandshakeError` for a difference that no command takes back, or that comes back.
        """
        printer, logbook, before = self._printer, self._logbook, self._logbook.fault
        for command in blind_resets(printer):
            yield from self._channel.command(command.encode("ascii"), journalled)
        asked = questions(printer)
        answers = yield from self._answers(asked, journalled)
        for _ in range(_TRIES):  # a garbled answer differs, too
            every = setting_differences(answers, printer)
            refused = [one for one in every if not one.tolerated]
            if not refused:
                break
            for one in refused:
                if one.reset:
                    logbook.alarm(f"{one.what}; reset by {one.reset}")
                    yield from self._channel.command(one.reset.encode("ascii"), journalled)
            answers = yield from self._answers(asked, journalled)
        else:
            moved = "" if logbook.begun else ", and nothing was moved"
            words = "; ".join(
                f"{one.what}: {one.remedy or f'{one.reset} was sent without effect'}"
                for one in refused
            )
            raise HandshakeError(f"the firmware settings don't match the checks{moved}: {words}")
        for one in every:
            logbook.alarm(f"{one.what}: {one.remedy}")
        settings = reported_settings(answers, printer)
        logbook.excuse(before)  # a question that this build doesn't know
        logbook.record("settings", told=settings)
        self._settings = self._settings or settings

    def changed_at_panel(self) -> Steps[list[Difference]]:
        """Return which factors or offsets aren't as set before the job; two answers alike tell."""
        printer, before = self._printer, self._logbook.fault
        asked = panel_questions(printer)
        found = setting_differences((yield from self._answers(asked, True)), printer)
        if found:  # no checksum guards an answer
            again = setting_differences((yield from self._answers(asked, True)), printer)
            found = [one for one in found if one in again]
        self._logbook.excuse(before)  # a question that this build doesn't know
        return found

    @property
    def tells_factors(self) -> bool:
        """Whether the firmware can be asked for what a panel can change."""
        return bool(panel_questions(self._printer))

    def _answers(self, questions: Sequence[str], journalled: bool) -> Steps[dict[str, list[str]]]:
        """Return the answers to questions about settings."""
        answers: dict[str, list[str]] = {}
        for question in questions:
            lines = yield from self._channel.command(question.encode("ascii"), journalled)
            answers[question] = [line.decode("ascii", "replace") for line in lines]
        return answers

    def restore_settings(self, settings: dict[str, str]) -> None:
        """Take the settings as they were before the job, from its journal."""
        self._settings = settings

    def undo_settings(self) -> Steps[None]:
        """Set the firmware's settings as they were before the job, where it has changed them.

        Where it had no switch-off of its own, the job's stays while a heater is on: nothing else
        would switch that off, once this process has ended.
        """
        for code in settings_changed_by(self._logbook.progress.taken, self._printer):
            before = self._settings.get(code, "")
            if before and self._ends_switch_off(before) and (yield from self._heats()):
                self._logbook.alarm(
                    "a heater is on, so the firmware idle timeout stays as set by the job "
                    f"({code}); {before} restores it"
                )
            elif before:
                yield from self._channel.command(before.encode("ascii"))

    def _ends_switch_off(self, command: str) -> bool:
        """Whether with this command the firmware would never switch off by itself."""
        family = family_of(self._printer)
        return bool(family.timeout_code) and command == family.timeout_command("0")

    def _heats(self) -> Steps[bool]:
        """Whether a heater, whatever its letter, has a target."""
        answer = yield from self._channel.command(b"M105")
        return any(float(target) for text in answer for target in _TARGET.findall(text))
