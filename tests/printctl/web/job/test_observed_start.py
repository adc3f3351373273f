"""Observer of a run's print that is started from the page, and of one that is gone on with."""

from __future__ import annotations

import os
import signal
import sys
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml

from printctl.machine.link import LinkState
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.record import load_record
from printctl.observe.deciding import Limits
from printctl.observe.devices import DeviceSettings
from printctl.observe.order import ObserverOrder
from printctl.observe.records import ORDER, READY, read_looks
from printctl.observe.starting import ObserverError
from printctl.run_folder.artefacts import GCODE
from printctl.run_folder.manifest import Manifest
from printctl.web.errors import ConflictError
from tests.printctl.machine.link.layered import layered
from tests.printctl.web.job.conftest import OPERATOR, ready
from tests.printctl.web.job.test_printing import WORDS, until

JOB = "run~observed"
RECIPE = {
    "schema": 1,
    "name": "observed",
    "tissue": {"shape": "block", "size_mm": [8, 8, 1]},
    "vasculature": {"grow": "tree", "terminals": 2, "smallest_diameter_mm": 0.2},
    "flow": {"viscosity_mpa_s": 1.0, "inlet_flow_ml_min": 0.05},
    "toolpath": {"method": "fresh", "needle": "28g"},
    "printer": {
        "profile": "generic_marlin",
        "port": "simulated",
        "syringe": "hamilton_1ml",
        "ink": "collagen_fresh",
        "bath": "gelatin_support",
    },
    "observe": {"device": "camera"},
}
CAMERA = {
    "camera": {"size_px": [200, 200], "um_per_px": 50, "target_mm": [50, 50, 1]},
    "laid": {"printer": "generic_marlin", "syringe": "hamilton_1ml", "ink": "collagen_fresh"},
}


COPIES = """
import pathlib, shutil, sys, time
here, out = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
while out.parent.name == "0002" and not (here / "works").exists():
    time.sleep(0.05)
shutil.copy(here / f"grey{out.parent.name}.png", out.with_suffix(".png"))
"""


@pytest.fixture
def order(core, tmp_path) -> ObserverOrder:
    """A run whose camera is a program that copies grey pictures, and hangs in the second look."""
    folder = core.workspace.root / "runs" / "observed"
    folder.mkdir(parents=True)
    (folder / GCODE).write_bytes(layered(3, 20))
    manifest = Manifest(folder)
    manifest.facts = {"recipe": RECIPE}
    manifest.save()
    for look in range(4):
        grey = np.full((200, 200), 126 + look, np.uint8)
        cv2.imwrite(str(tmp_path / f"grey{look:04d}.png"), grey)
    (tmp_path / "camera.yaml").write_text(yaml.safe_dump(CAMERA))
    (tmp_path / "copy.py").write_text(COPIES)
    words = f"{sys.executable} {tmp_path / 'copy.py'} {{out}}"
    device = DeviceSettings("command", words, extra={"camera": str(tmp_path / "camera.yaml")})
    made = ObserverOrder(
        job=str(folder / GCODE),
        profile="generic_marlin",
        syringe="hamilton_1ml",
        ink="collagen_fresh",
        needle="28g",
        embedded=False,
        oct=False,
        frame="",
        device=device,
        limits=Limits(mend="tell"),
        care={"look_after": "layer", "look_limit_s": 8.0},
    )
    made.save(folder)
    return made


@pytest.mark.slow
def test_a_print_from_the_page_is_looked_at_and_after_a_resume_as_well(
    service, station, order, tmp_path
):
    folder = service.core.workspace.print_folder(JOB)
    service.start(OPERATOR, JOB, ready(service, JOB), WORDS)
    assert load_record(folder).care["look_after"] == MarkKind.LAYER
    while not (folder / "looks" / "0002").is_dir():
        time.sleep(0.02)
    first = int((folder / READY).read_text())
    os.kill(first, signal.SIGKILL)
    held = until(service, JOB, LinkState.PAUSED)
    assert "nobody decided" in held.status.message
    (tmp_path / "works").touch()
    service.hands.resume(OPERATOR, JOB)
    assert int((folder / READY).read_text()) != first
    assert until(service, JOB, LinkState.DONE).status.alarms == 1
    assert [(one.number, one.decision) for one in read_looks(folder)] == [
        (1, "go_on"),
        (3, "go_on"),
    ]


@pytest.mark.slow
def test_nothing_moves_where_the_observer_cannot_be_started(service, station, order):
    folder = service.core.workspace.root / "runs" / "observed"
    broken = replace(order.device, source="/nowhere/look {out}")
    replace(order, device=broken).save(folder)
    said = ready(service, JOB)
    with pytest.raises(ObserverError, match=r"/nowhere/look isn't there.*Nothing was moved"):
        service.start(OPERATOR, JOB, said, WORDS)
    assert service.heard(JOB) is None


def test_nothing_moves_where_nobody_says_how_to_observe(service, station, order):
    said = ready(service, JOB)
    (service.core.workspace.root / "runs" / "observed" / ORDER).unlink()
    with pytest.raises(ConflictError, match="make the run anew"):
        service.start(OPERATOR, JOB, said, WORDS)
    assert service.heard(JOB) is None
