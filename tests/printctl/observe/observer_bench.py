"""An observer between a link that notes what is said and devices that a test makes."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from printctl.inspection.values import Gap
from printctl.machine.errors import Refused
from printctl.observe.deciding import (
    Decider,
    Evidence,
    FlowBlocks,
    FlowControl,
    InkSupply,
    Limits,
    SupplyState,
)
from printctl.observe.devices import DeviceError
from printctl.observe.looks.look_context import Look, LookJudgement, MendLines
from printctl.observe.observer import Observer
from printctl.observe.records import answer_look

GAP = Gap(2, 0.0, 1.0, (0.0, 0.0), (1.0, 0.0), 0.01, 1e-12)
LOOK = Look(1, 100, 100, 0, "end of layer 0")


@dataclass
class FakeLink:
    """Notes what is said; refuses inserts where told to."""

    refuses: bool = False
    said: list[tuple] = field(default_factory=list)

    def insert(self, look, lines, why, flow=None, again=False):
        if self.refuses:
            raise Refused("the gate says no")
        self.said.append(("insert", look, tuple(lines), flow, *["again"] * again))

    def decide(self, look, decision, why, again=False):
        self.said.append((decision, look, *["again"] * again))

    def resume(self):
        self.said.append(("resume",))

    def stop(self):
        self.said.append(("stop",))


FLOWING = InkSupply(SupplyState.FLOWING)


def flow(ratio, count=30):
    full = np.full(count, ratio)
    return FlowBlocks(np.arange(float(count)), full, np.full(count, 0.02), np.ones(count))


def evidence(**changed):
    """Evidence of a sound layer, changed as a test says."""
    given = {"places": 400, "gaps": (), "second_gaps": None, "supply": FLOWING, "seen_share": 0.95}
    return Evidence(**{**given, "flow": flow(1.0), "way_mm": 100.0, **changed})


def decided(mode="mend", **changed):
    return Decider(Limits(mend=mode)).decide(evidence(**changed))


@dataclass
class Bench:
    """An observer between fakes."""

    folder: Path
    mode: str = "mend"
    gaps: tuple = ()
    ratio: float = 1.0
    again: bool = True
    refuses: bool = False
    hangs: bool = False
    one_each: bool = False
    over: bool = False
    thin: tuple = ()
    lines: tuple = ("G1 X1 E1",)
    left: str = ""
    mended: tuple = ()
    in_vain: bool = False
    not_seen: str = ""
    seen_share: float = 0.9
    answer: str = ""
    pictures: list[str] = field(default_factory=list)

    def __post_init__(self):
        self.link = FakeLink(self.refuses)
        if self.answer:
            self.link.decide = answering(self, self.answer)
        self.observer = self.another()

    def another(self) -> Observer:
        """An observer that knows nothing but the files."""
        return Observer(
            self.folder, self.link, self.acquire, self.judge,
            self.mend_lines,
            Decider(Limits(mend=self.mode), FlowControl()),
            lambda _: self.over and bool(self.link.said),
        )  # fmt: skip

    def mend_lines(self, look, gaps, thin, flow, approved):
        given_up = self.in_vain and not approved
        lines = () if given_up else tuple(self.lines)
        left = "written 2 times more" if given_up else self.left
        return MendLines(lines, left, 0.22 * bool(left), self.mended, given_up)

    def acquire(self, look, out):
        if self.hangs:
            raise DeviceError("the camera gave no picture within 20 s")
        if self.one_each and self.pictures:
            raise DeviceError("no new picture came into pics within 16 s")
        self.pictures.append(out.name)
        path = out.with_suffix(".png")
        path.touch()
        return path

    def judge(self, look, picture, again):
        seen = self.gaps if again is None or self.again else ()
        found = {"seen_share": self.seen_share}
        found |= {"not_seen": self.not_seen} if self.not_seen else {}
        told = evidence(
            gaps=self.gaps, flow=flow(self.ratio), seen_share=self.seen_share, thin=self.thin,
            second_gaps=None if again is None else seen,
        )  # fmt: skip
        return LookJudgement(told, found)


def answering(bench, word):
    def decide(look, decision, why, again=False):
        bench.link.said.append((decision, look))
        answer_look(bench.folder, look, word)

    return decide
