"""What is asked of a printer before anything is sent that moves: who it is, and how it counts."""

from __future__ import annotations

from typing import Final

from printctl.link.agreeing import agree_settings
from printctl.link.errors import HandshakeError
from printctl.link.families import family_of
from printctl.link.firmware import differences, modes, parse_firmware
from printctl.link.gating import is_of_the_line
from printctl.link.measuring import Measuring
from printctl.link.placing import RETRIES
from printctl.link.valve import shut

BOOT_LISTEN_S: Final = 1.0
BOOT_QUIET_S: Final = 0.5
BOOT_LIMIT_S: Final = 10.0
CONNECT_LIMIT_S: Final = 15.0


class Checking(Measuring):
    """Finds a printer at a port and checks it; see `Measuring` for what it is given."""

    def _connect(self) -> None:
        if self.wiring.fresh and self.wiring.printer.resets_on_connect:
            self._await_boot()
        limit = self.wiring.clock.now() + CONNECT_LIMIT_S
        while True:
            try:
                self._agree(self.protocol.renumber)
            except HandshakeError:  # some boards sit in their boot loader for long
                if self.wiring.clock.now() > limit:
                    raise
            else:
                return

    def _await_boot(self) -> None:
        """Give a board that resets when the port opens the time to say so, and to wake up."""
        clock = self.wiring.clock
        listen_until = clock.now() + BOOT_LISTEN_S
        while clock.now() < listen_until and not self._booted:
            self._pump(listen_until)
        limit, heard = clock.now() + BOOT_LIMIT_S, -1
        while self._booted and heard != self._heard and clock.now() < limit:
            heard = self._heard
            until = clock.now() + BOOT_QUIET_S
            while clock.now() < until:
                self._pump(until)

    def _check(self) -> None:
        family = family_of(self.wiring.printer)
        for _ in range(RETRIES):
            self.firmware = parse_firmware(self._command(b"M115", journalled=False))
            if self.firmware.is_a(family.says):
                break
        else:
            name = self.firmware.name or "nothing"
            raise HandshakeError(
                f"{self.wiring.transport.name} answers M115 with {name!r}, the profile expects "
                f"{self.wiring.printer.firmware}; choose the profile of this printer"
            )
        self._check_heads()
        self._check_keepalive(journalled=False)
        if family.tells_steps:
            self._check_steps()
        else:
            self._record("notice", text="this firmware doesn't tell its steps per mm (M92)")
        self._agree_settings(journalled=False)
        printer = self.wiring.printer  # which an earlier job may have left otherwise
        for mode in (*shut(printer), *modes(printer)):
            self._command(mode, journalled=False)
        self._check_at_rest()
        if not self._journal_lost:
            self._fault = ""  # a firmware without M113 says so; that is no fault of the job

    def _agree_settings(self, journalled: bool) -> None:
        """Have the firmware as checks count on; write down what a job may change."""

        def ask(text: bytes) -> tuple[bytes, ...]:
            return self._command(text, journalled)

        fault = self._fault
        told = agree_settings(ask, self.wiring.printer, self._alarm)
        if is_of_the_line(self._fault):
            self._fault = fault  # a question that this build doesn't know
        self._record("settings", told=told)
        self._settings = self._settings or told

    def _check_heads(self) -> None:
        """Refuse a firmware that was built for fewer heads: it would push one syringe for all."""
        built, wanted = self.firmware.extruders, len(self.wiring.printer.heads)
        if 0 < built < wanted:
            raise HandshakeError(
                f"the firmware was built for {built} (EXTRUDER_COUNT), the profile names {wanted} "
                "heads: it would go on with one where the job takes another; build it with "
                f"EXTRUDERS {wanted}, or choose the profile of this printer"
            )

    def _check_keepalive(self, journalled: bool) -> None:
        """Have the firmware say every second that it is busy, and see that it will."""
        if not family_of(self.wiring.printer).keepalive:
            self.protocol.keepalive = False
            return
        for _ in range(RETRIES):
            self._command(b"M113 S1", journalled)
            if any(b"M113 S1" in text for text in self._command(b"M113", journalled)):
                return
        self.protocol.keepalive = False
        self._alarm("the firmware sends no busy messages (M113); a lost ok costs a minute")

    def _check_steps(self) -> None:
        """Refuse a printer whose steps per mm aren't the profile's; note other differences."""
        found: list[str] = []
        for _ in range(RETRIES):
            steps = self._command(b"M92", journalled=False)
            found = differences(self.firmware, steps, self.wiring.printer)
            if not any("steps/mm" in text for text in found):
                break
        for text in found:
            if "steps/mm" in text:
                raise HandshakeError(
                    f"{text}: distances or doses would be wrong; set the firmware (M92, M500) or "
                    "correct the profile"
                )
            self._alarm(text)
