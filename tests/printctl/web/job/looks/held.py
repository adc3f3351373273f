"""Print in a workspace that is held for its first look, with looks' records and pictures."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from printctl.machine.control.look_book import LookDecision
from printctl.machine.job.care import Care
from printctl.machine.job.marks import MarkKind
from printctl.machine.process.clients.client import PrintClient
from printctl.machine.process.clients.starting import start_print
from printctl.machine.process.contact import hold_folder
from printctl.machine.process.orders import Order
from printctl.machine.records.states import LinkState
from printctl.observe.records import OBSERVER_LOCK, LookRecord, look_folder, save_look
from printctl.web.workspace import Workspace
from tests.printctl.machine.link.fake_marlin import FakeMarlin, pty_printer
from tests.printctl.machine.link.jobs import quick_profile
from tests.printctl.machine.link.layered import layered

JOB = "file~zigzag.gcode"
SIZE = (900, 700)


def picture(folder: Path, number: int, size: tuple[int, int] = SIZE) -> None:
    """A grey bath with blue lines; every third look lacks a piece of one, outlined in red."""
    rng = np.random.default_rng(number)
    bath = rng.normal(170, 8, (size[1], size[0], 3)).clip(0, 255).astype(np.uint8)
    image = Image.fromarray(bath)
    pen = ImageDraw.Draw(image)
    for y in range(80, size[1] - 60, 70):
        pen.line([(80, y), (size[0] - 80, y)], fill=(60, 80, 160), width=22)
    if number % 3 == 1:
        pen.rectangle([400, 270, 520, 312], fill=(170, 168, 160), outline=(220, 30, 30), width=4)
    image.save(look_folder(folder, number) / "seen.png")


def record(number: int, decision: str = "go_on", asked: str = "", at: float = 0.0) -> LookRecord:
    why = "1 gap, 0.62 mm in all" if asked else "as expected, within tolerance"
    found = {"seen_share": 0.97, "coverage": 0.91 if asked else 0.995, "gaps": []}
    return LookRecord(
        number, 10 * number, 10 * number, f"end of layer {number}", at or time.time(), decision,
        why, asked, 1.06 if asked else None, found,
    )  # fmt: skip


@contextmanager
def print_held_for_a_look(workspace: Workspace, observed: bool = True) -> Iterator[PrintClient]:
    """A print on a scripted printer, paused by its first look, which asks to mend."""
    file = workspace.root / "jobs" / "zigzag.gcode"
    file.write_bytes(layered(3, 6))
    folder = workspace.print_folder(JOB)
    profile = quick_profile(workspace.root)
    care = Care(checkpoint_s=None, look_after=MarkKind.LAYER)
    with pty_printer(FakeMarlin()) as served:
        client = start_print(Order(file, profile, served.name, folder, care=care))
        try:
            _until(client, LinkState.LOOKING)
            picture(folder, 1)
            save_look(folder, record(1, "pause", "mend"))
            client.decide(1, LookDecision.PAUSE, "1 gap, 0.62 mm in all")
            _until(client, LinkState.PAUSED)
            if observed:
                with hold_folder(folder, OBSERVER_LOCK):
                    yield client
            else:
                yield client
        finally:
            if not client.status.ended:
                client.stop()
                client.wait(300)
            client.detach()


def _until(client: PrintClient, state: LinkState) -> None:
    for status in client.events():
        if status.state is state:
            return
        assert not status.ended, status
    raise AssertionError(f"never {state}")
