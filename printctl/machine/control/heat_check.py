"""Compare heater targets with this print's own; take back those that another program raised."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from printctl.checks.gate import AllowedLine, LineOrigin, PrinterSituation, judge
from printctl.machine.control.channel import Channel
from printctl.machine.errors import HandshakeError
from printctl.machine.job.temperatures import parse_temperatures, target_command

WARM_ROOM_C: Final = 35.0
"""Up to it a reading may be the room's own: no heater that is switched off makes it colder."""
WITHIN_C: Final = 0.6
"""Between a target that was set and the one that is told: some firmwares round it."""


class HeatCheck:
    """Finds targets that neither the job nor its operator has set.

    Of several nozzles none is looked at: a command without a number sets the one in use.

    Parameters
    ----------
    channel : Channel
    """

    def __init__(self, channel: Channel) -> None:
        self._channel, self._logbook = channel, channel.logbook
        self._targets: dict[str, float] = {}
        self._read = 0

    def begin(self) -> None:
        """Take the targets as they are before the job's first line.

        Raises
        ------
        HandshakeError
            For a heater that is hotter than anything in this print bears, or is set to be.
        """
        before = self._logbook.fault
        first = self._told(journalled=False)
        on = {heater: celsius for heater, celsius in first.items() if celsius > 0}
        off = {heater: celsius for heater, celsius in first.items() if celsius == 0}
        self._targets = off | self._told_twice(on, journalled=False)
        self._refuse_heat()
        self._logbook.excuse(before)  # a firmware without heaters may not know the question
        self._record()

    def _refuse_heat(self) -> None:
        """Refuse what a second reading confirms; what the job itself heats to is preflight's."""
        hottest: dict[str, tuple[str, str]] = {}
        own = self._job_targets(self._logbook.progress.job.lines)
        for _ in range(2):
            readings = parse_temperatures(self._channel.command(b"M105", journalled=False))
            seen = {}
            for one in readings:
                limit = self._channel.wiring.limits().hottest(one.name)
                bears = max(limit.celsius, *own.get(one.name, [limit.celsius]))
                if one.now_c > max(bears, WARM_ROOM_C) + WITHIN_C:
                    seen[one.name] = f"is at {one.now_c:g} °C", f"{bears:g} °C ({limit.why})"
                elif one.target_c is not None and one.target_c > bears and one.name not in own:
                    seen[one.name] = f"is set to {one.target_c:g} °C", f"{bears:g} °C ({limit.why})"
            hottest = {k: v for k, v in seen.items() if not hottest or k in hottest}
            if not hottest:
                return
        words = "; ".join(f"the {name} {is_at}, above {bears}" for name, (is_at, bears) in
                          hottest.items())  # fmt: skip
        raise HandshakeError(
            f"{words}: nothing was moved. Switch it off, let it cool, and start again"
        )

    def _job_targets(self, lines: Sequence[bytes]) -> dict[str, list[float]]:
        """Return each target that lines of the job set, °C, by heater."""
        targets: dict[str, list[float]] = {}
        known = PrinterSituation.of_job(self._channel.wiring.printer)
        for line in lines:
            if not line.startswith((b"G0", b"G1")):
                verdict = judge(line.decode("ascii", "replace"), LineOrigin.JOB, known)
                if isinstance(verdict, AllowedLine) and verdict.heater:
                    targets.setdefault(verdict.heater, []).append(verdict.celsius)
        return targets

    def restore(self, targets: Mapping[str, float], read: int) -> None:
        """Take the targets that this print had set after ``read`` lines, from its journal."""
        self._targets, self._read = dict(targets), read

    def set_by_hand(self, allowed: AllowedLine) -> None:
        """Take notice of a target that a person has set in the print."""
        if allowed.heater and self._targets:
            self._read_job()
            self._targets[allowed.heater] = allowed.celsius
            self._record()

    def take_back(self) -> None:
        """Set anew what others have set; tell of it, and of heaters that went off."""
        if not self._targets:
            return
        self._read_job()
        told = self._told(journalled=True)
        others = {
            heater: celsius
            for heater, celsius in told.items()
            if abs(celsius - self._targets.get(heater, celsius)) > WITHIN_C
        }
        for heater, celsius in self._told_twice(others, journalled=True).items():
            wanted = self._targets[heater]
            self._targets[heater] = min(celsius, wanted)
            if celsius < wanted:
                self._logbook.alarm(
                    f"the {heater} is set to {celsius:g} °C, and this print had set {wanted:g} °C: "
                    "the firmware or another program did it; it stays so"
                )
                continue
            command = target_command(heater, wanted)
            self._logbook.alarm(
                f"the {heater} is set to {celsius:g} °C, and this print had set {wanted:g} °C: "
                f"another program did it; taken back ({command})"
            )
            self._channel.command(command.encode("ascii"))

    def _told_twice(self, heaters: Mapping[str, float], journalled: bool) -> dict[str, float]:
        """Those of ``heaters`` that a second answer agrees on: no checksum guards the first."""
        if not heaters:
            return {}
        again = self._told(journalled)
        return {
            heater: celsius for heater, celsius in heaters.items() if again.get(heater) == celsius
        }

    def _told(self, journalled: bool) -> dict[str, float]:
        """Targets by heater, °C; empty where the firmware tells none."""
        readings = parse_temperatures(self._channel.command(b"M105", journalled))
        targets = {one.name: one.target_c for one in readings if one.target_c is not None}
        several = len(self._channel.wiring.printer.heads) > 1
        return {k: v for k, v in targets.items() if not (several and k.startswith("nozzle"))}

    def _record(self) -> None:
        self._logbook.record("heat", targets=self._targets, line=self._read)

    def _read_job(self) -> None:
        """Take notice of what the job's own lines have set since they were last read."""
        taken = self._logbook.progress.taken
        for heater, targets in self._job_targets(taken[self._read :]).items():
            self._targets[heater] = targets[-1]
        self._read = len(taken)
