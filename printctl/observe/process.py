"""Observe one print until it is over, as a client of its link process."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from printctl.link.client import PrintClient, attach
from printctl.link.errors import LinkError
from printctl.link.inserts import file_count
from printctl.link.journalled_print import read_journal
from printctl.link.look_book import LookDecision
from printctl.link.process import hold_folder
from printctl.link.record import JOURNAL
from printctl.observe.deciding import Decider, FlowControl
from printctl.observe.devices import acquire
from printctl.observe.looking_at import ObservedJob
from printctl.observe.observer import Look, Observer
from printctl.observe.order import ObserverOrder
from printctl.observe.records import OBSERVER_LOCK, read_looks
from printctl.printing.journal_facts import read_journal_facts

LOG: Final = "observer.log"
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LinkWords:
    """What the observer says to the link, on a connection of its own.

    Attributes
    ----------
    client : PrintClient
    """

    client: PrintClient

    def insert(
        self, look: int, lines: Sequence[str], why: str, flow: float | None = None
    ) -> object:
        """Put lines into the job, and correct the flow of its rest."""
        return self.client.looks.insert(look, lines, why, flow)

    def look_done(self, look: int, decision: str, why: str) -> None:
        """End a look."""
        self.client.looks.decide(look, LookDecision(decision), why)

    def resume(self) -> None:
        """Go on after a pause."""
        self.client.resume()

    def stop(self) -> None:
        """Stop the print."""
        self.client.stop()


def observe(folder: Path) -> None:
    """Observe the print in ``folder`` until it is over.

    Raises
    ------
    AlreadyPrinting
        When another observer is at work there.
    LinkError
        When there is no print.
    """
    order = ObserverOrder.load(folder)
    handled: set[int] = set()  # what was said before a look ended is heard after it
    with (
        hold_folder(folder, OBSERVER_LOCK, "an observer is at work"),
        attach(folder) as words,
        attach(folder) as events,
    ):
        observer = _assembled(folder, order, words)
        for status in events.events():
            look = status.look
            if look is not None and look["number"] not in handled:
                if not handled:
                    observer.remember(look["number"])
                handled.add(look["number"])
                _look(observer, look)


def _assembled(folder: Path, order: ObserverOrder, words: PrintClient) -> Observer:
    begun = read_journal_facts(folder / JOURNAL).started
    job = ObservedJob(folder, order, begun)
    return Observer(
        folder=folder,
        link=LinkWords(words),
        acquire=lambda out: acquire(order.device, out, time.time()),
        judge=job.judge,
        mend_lines=job.mend_lines,
        decider=Decider(order.limits, FlowControl(order.limits.flow)),
        ended=partial(_gone_on, words),
        begun=begun,
    )


def _look(observer: Observer, told: dict[str, Any]) -> None:
    """Look once; whatever goes wrong here pauses the print for the operator."""
    try:
        if told["decision"]:
            if told["decision"] == "pause" and _asked(observer, told["number"]):
                observer.ask_again(look_of(told, observer))
        elif told["insert_sha256"]:  # an observer put it in and died before it said so
            observer.link.look_done(told["number"], "go_on", "mended by an observer that died")
        else:
            record = observer.look(look_of(told, observer))
            log.info("look %d: %s: %s", record.number, record.decision, record.why)
    except Exception as exc:  # a fault of ours must not leave the needle waiting for nobody
        log.exception("look %d failed", told["number"])
        with suppress(LinkError):  # it was decided already
            observer.link.look_done(told["number"], "pause", f"the observer failed: {exc}")


def _asked(observer: Observer, number: int) -> bool:
    """Whether a look's record asks the operator for something."""
    looks = read_looks(observer.folder, observer.begun)
    return any(one.number == number and one.asked for one in looks)


def look_of(told: dict[str, Any], observer: Observer) -> Look:
    """Return a look as the status tells it, with where the one before was."""
    positions = read_journal(observer.folder / JOURNAL).positions
    done = int(told["done"])
    looks = read_looks(observer.folder, observer.begun)
    earlier = [one.done for one in looks if one.done < done]
    return Look(
        number=int(told["number"]),
        done=done,
        job_line=file_count(done, positions),
        before=max(earlier, default=0),
        mark=str(told["mark"]),
    )


def _gone_on(client: PrintClient, number: int) -> bool:
    """Whether the print isn't held for a look any more."""
    look = client.status.look
    return look is None or look["number"] != number
