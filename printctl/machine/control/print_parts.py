"""Create and connect the objects that carry out one print: channel, checks, pauses, stop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from printctl.machine.control.channel import Channel
from printctl.machine.control.ending import Ending
from printctl.machine.control.events import print_channel
from printctl.machine.control.excursion import Excursion
from printctl.machine.control.firmware import FirmwareCheck
from printctl.machine.control.gauges import Gauge
from printctl.machine.control.head_choice import HeadChoice
from printctl.machine.control.heat import HeatCheck
from printctl.machine.control.idle_motors import IdleMotors
from printctl.machine.control.inserting import Inserting
from printctl.machine.control.interruption import Interruption
from printctl.machine.control.logbook import Logbook
from printctl.machine.control.look_book import LookBook
from printctl.machine.control.look_requests import LookRequests
from printctl.machine.control.looks import Looks
from printctl.machine.control.manual_commands import ManualCommands
from printctl.machine.control.others import ForeignCommands, OtherClients
from printctl.machine.control.parking import Parking
from printctl.machine.control.pauses import Pauses
from printctl.machine.control.place import PositionCheck, SlipWatch
from printctl.machine.control.print_details import PrintDetails
from printctl.machine.control.print_requests import PrintRequests
from printctl.machine.control.progress import JobProgress
from printctl.machine.control.requests import RequestQueue
from printctl.machine.control.resumption import Resumption
from printctl.machine.control.returning import Returning
from printctl.machine.control.syringe_change import SyringeChange
from printctl.machine.control.syringe_changer import SyringeChanger
from printctl.machine.control.valve_switch import ValveSwitch
from printctl.machine.control.watch import Watch
from printctl.machine.control.wiring import Wiring
from printctl.machine.job.care import Care
from printctl.machine.job.job import Job

# Detect another program's lines to the printer: send a token at intervals, count oks before it.

EVERY_S: Final = 5.0
"""Interval of comparisons: each costs a line and its answer, while the planner goes on."""


class AnswerCount:
    """Notices lines that another program wrote to the printer.

    Such a line is answered by an ok that is taken for the next line's, and so on: from then on each
    ok is one line early. What the protocol asks to `confirm` shows it: one ok more comes before.

    Parameters
    ----------
    channel : Channel

    Attributes
    ----------
    next_due : float, s
        When they are compared next.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self.next_due, self._troubles = math.inf, 0

    def begin(self, now: float) -> None:
        """Compare for the first time a while after ``now``."""
        self.next_due, self._troubles = now + EVERY_S, self._channel.troubles

    def look(self, now: float) -> None:
        """Compare where that is due; the protocol tells of what is too many."""
        if now < self.next_due:
            return
        troubles, self._troubles = self._troubles, self._channel.troubles
        if troubles != self._troubles:  # answers that were late may come yet
            self.next_due = now + 2.0 * EVERY_S
            return
        self._channel.settle()
        self._channel.agree(self._channel.wiring.protocol.confirm)
        self.next_due = self._channel.wiring.clock.now() + EVERY_S


@dataclass(frozen=True)
class PrintParts:
    """What the loop of a print uses; each owns its own state.

    Attributes
    ----------
    channel : Channel
    queue : RequestQueue
    requests : PrintRequests
    look_requests : LookRequests
    commands : ManualCommands
    watch : Watch
    gauges : list of Gauge
    answers : AnswerCount
    clients : OtherClients
    firmware : FirmwareCheck
    position : PositionCheck
    meddling : ForeignCommands
    heat : HeatCheck
    valve : ValveSwitch
    ending : Ending
    pauses : Pauses
    looks : Looks
    slips : SlipWatch
    resumption : Resumption
    interruption : Interruption
    """

    channel: Channel
    queue: RequestQueue
    requests: PrintRequests
    look_requests: LookRequests
    commands: ManualCommands
    watch: Watch
    gauges: list[Gauge]
    answers: AnswerCount
    clients: OtherClients
    firmware: FirmwareCheck
    position: PositionCheck
    meddling: ForeignCommands
    heat: HeatCheck
    valve: ValveSwitch
    ending: Ending
    pauses: Pauses
    looks: Looks
    slips: SlipWatch
    resumption: Resumption
    interruption: Interruption


def assemble(wiring: Wiring, job: Job, care: Care) -> PrintParts:
    """Return the parts of a print, each given those that it uses."""
    progress, queue = JobProgress(wiring, job), RequestQueue()
    watch = Watch(job.marks, care, job.lines, job.positions)
    change = SyringeChange(wiring, progress)
    book = LookBook()
    watched = [Gauge(one) for one in wiring.printer.watch]
    details = PrintDetails(wiring.clock, watched, watch, change, book)
    logbook = Logbook(wiring, progress, details.add, details.next_due)
    channel, interruption = print_channel(wiring, logbook, queue)
    requests = PrintRequests(wiring, logbook, queue, watch, change)
    look_requests = LookRequests(logbook, queue, book)
    heat, valve = HeatCheck(channel), ValveSwitch(channel)
    commands = ManualCommands(channel, queue, heat)
    firmware, heads = FirmwareCheck(channel), HeadChoice(channel)
    position = PositionCheck(channel)
    meddling, excursion = ForeignCommands(channel, firmware, position, heat), Excursion()
    returning = Returning(channel, heads, position, excursion)
    ending = Ending(channel, firmware, heads, position, valve, excursion, interruption)
    changer = SyringeChanger(channel, change, heads, position, watch)
    inserting = Inserting(channel, queue, watch, changer, book, job)
    pauses = Pauses(
        channel=channel,
        queue=queue,
        requests=requests,
        commands=commands,
        watch=watch,
        change=change,
        changer=changer,
        position=position,
        meddling=meddling,
        heads=heads,
        valve=valve,
        motors=IdleMotors(channel),
        ending=ending,
        excursion=excursion,
        returning=returning,
        inserting=inserting,
    )
    parking = Parking(channel, heads, position, inserting)
    looks = Looks(channel, pauses, inserting, parking)
    return PrintParts(
        channel=channel,
        queue=queue,
        requests=requests,
        look_requests=look_requests,
        commands=commands,
        watch=watch,
        gauges=watched,
        answers=AnswerCount(channel),
        clients=OtherClients(channel, position, heat),
        firmware=firmware,
        position=position,
        meddling=meddling,
        heat=heat,
        valve=valve,
        ending=ending,
        pauses=pauses,
        looks=looks,
        slips=SlipWatch(channel, position),
        resumption=Resumption(
            channel,
            firmware,
            heat,
            meddling,
            heads,
            position,
            valve,
            watch,
            pauses,
            looks,
            parking,
            excursion,
            returning,
            requests,
        ),
        interruption=interruption,
    )
