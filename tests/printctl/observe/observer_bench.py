"""An observer between a link that notes what is said and devices that a test makes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from printctl.machine.link.errors import Refused
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
from printctl.observe.look_values import Judged, Look, MendLines
from printctl.observe.observer import Observer
from printctl.observe.records import answer_look
from registration.inspection.values import Gap

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

    def look_done(self, look, decision, why, again=False):
        self.said.append((decision, look, *["again"] * again))

    def resume(self):
        self.said.append(("resume",))

    def stop(self):
        self.said.append(("stop",))


def evidence(gaps=(), ratio=1.0):
    full = np.full(30, ratio)
    flow = FlowBlocks(np.arange(30.0), full, np.full(30, 0.02), np.ones(30))
    supply = InkSupply(SupplyState.FLOWING, 0, None, 0)
    return Evidence(400, gaps, None, supply, flow, 0.9, way_mm=100.0)


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
    pictures: list[str] = field(default_factory=list)

    def __post_init__(self):
        self.link = FakeLink(self.refuses)
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
        one = evidence(self.gaps, self.ratio)
        second = None if again is None else seen
        one = replace(one, seen_share=self.seen_share)
        found = {
            "seen_share": self.seen_share,
            **({"not_seen": self.not_seen} if self.not_seen else {}),
        }
        return Judged(Evidence(**{**vars(one), "second": second, "thin": self.thin}), found)


def answering(bench, word):
    def look_done(look, decision, why, again=False):
        bench.link.said.append((decision, look))
        answer_look(bench.folder, look, word)

    return look_done
