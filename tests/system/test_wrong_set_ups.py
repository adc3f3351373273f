"""No wrong set-up extrudes without a question, whichever way a print is started."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from starlette.testclient import TestClient

from design.network_files.csv_format import write_network_csv
from printctl.machine.process.clients.client import Station
from printctl.machine.process.clients.starting import connect
from tests.printctl.machine.link.fake_marlin import FakeMarlin, PtyPrinter, pty_printer
from tests.printctl.web.job.conftest import shut
from tests.printctl.web.serving import served
from tests.system.cli import called, recipe_file
from tests.system.forks import FORK
from tests.system.test_plate_run import RECIPE as PLATE
from tests.system.wrong_set_ups import (
    FAULTS,
    MACHINE_FAULTS,
    OF_THE_MACHINE,
    PLATE_FAULTS,
    RECIPE_FAULTS,
    SetUpOnTest,
)
from tests.waiting import wait_for

SCAN = {"=": "replace", "file": "later.tif", "voxel_um": [10, 10, 10]}


def cases(names: Iterable[str], quick: Iterable[str]) -> list[Any]:
    """Parameters of a test, of which only ``quick`` ones run each time."""
    return [
        pytest.param(name, marks=() if name in quick else pytest.mark.slow, id=name)
        for name in names
    ]


@pytest.fixture
def port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[PtyPrinter]:
    """A printer behind a port that counts as real."""
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    with pty_printer(FakeMarlin()) as served_port:
        yield served_port


@pytest.fixture
def sound(tmp_path: Path, port: PtyPrinter) -> SetUpOnTest:
    return SetUpOnTest(tmp_path, port.printer)


def refused(one: SetUpOnTest, *words: str | Path) -> None:
    """Assert that a command ends with a message, and without ink."""
    done = called(*words, cwd=one.folder)
    assert not one.extruded
    assert done.returncode in (2, 3, 4), done.stderr
    assert "printctl: " in done.stderr
    assert "Traceback" not in done.stderr


# --- `printctl print`


def print_words(one: SetUpOnTest, port: PtyPrinter) -> list[str | Path]:
    """Enter what is mounted; return the command that prints the job."""
    file, done = one.save(), called(*one.mount_words(), cwd=one.folder)
    assert done.returncode == 0, done.stderr
    words = ["--printer", one.names["printer"], "--port", port.name, "--yes"]
    return ["print", file, *words, *one.part_words(one.named)]


def test_the_sound_job_prints(sound: SetUpOnTest, port: PtyPrinter) -> None:
    done = called(*print_words(sound, port), cwd=sound.folder)
    assert done.returncode == 0, done.stderr
    assert len(sound.extruded) == 40


@pytest.mark.parametrize("fault", FAULTS)
def test_print_refuses(fault: str, sound: SetUpOnTest, port: PtyPrinter) -> None:
    FAULTS[fault](sound)
    refused(sound, *print_words(sound, port))


# --- `printctl simulate`


@pytest.mark.parametrize("fault", [one for one in FAULTS if one not in OF_THE_MACHINE])
def test_simulate_tells(fault: str, sound: SetUpOnTest) -> None:
    FAULTS[fault](sound)
    words = [*sound.part_words(sound.mounted | sound.named), *sound.place_words()]
    command = ("simulate", sound.save(), "--printer", sound.names["printer"], *words)
    done = called(*command, cwd=sound.folder)
    if fault in ("job cut off", "job without its lift"):  # no needle is left anywhere
        assert "the needle would stay in the print" in done.stderr
    else:
        assert done.returncode in (2, 3), done.stdout


# --- `printctl run`


def run_words(
    one: SetUpOnTest, port: PtyPrinter, change: Callable[[dict[str, Any]], None] | None = None
) -> list[str | Path]:
    """Enter what is mounted; return the command that runs a recipe up to its print."""
    one.mounted["needle"] = "22g_38mm"
    one.fill_ul *= 2
    coarse = {"=": "replace", "method": "fresh", "needle": "22g_38mm", "layer_um": 150}
    part = {"port": port.name, "profile": one.names["printer"], "bath_depth_mm": 8}
    part |= {name: one.names[name] for name in ("syringe", "ink", "bath", "dish")}
    sections = {"toolpath": {**coarse, "line_um": 400}, "printer": part, "scan": SCAN}
    recipe = recipe_file(one.folder, "planar_fresh", **sections)
    if change is not None:
        data = yaml.safe_load(recipe.read_text())
        change(data)
        recipe.write_text(yaml.safe_dump(data))
    assert called(*one.mount_words(), cwd=one.folder).returncode == 0
    return ["run", recipe, "--until", "print", "--yes", "--out", one.folder / "run"]


@pytest.mark.slow
def test_the_sound_recipe_prints(sound: SetUpOnTest, port: PtyPrinter) -> None:
    done = called(*run_words(sound, port), cwd=sound.folder)
    assert done.returncode == 0, done.stderr
    assert len(sound.extruded) > 1000


@pytest.mark.parametrize("fault", cases(RECIPE_FAULTS, ("another syringe", "a bath that stays")))
def test_run_refuses_a_recipe(fault: str, sound: SetUpOnTest, port: PtyPrinter) -> None:
    refused(sound, *run_words(sound, port, RECIPE_FAULTS[fault]))


@pytest.mark.parametrize("fault", cases(MACHINE_FAULTS, ("other ink", "nearly empty syringe")))
def test_run_refuses_what_is_mounted(fault: str, sound: SetUpOnTest, port: PtyPrinter) -> None:
    FAULTS[fault](sound)
    refused(sound, *run_words(sound, port))


def plate_words(
    one: SetUpOnTest,
    port: PtyPrinter,
    mounted: dict[str, str],
    change: Callable[[dict[str, Any]], None] | None = None,
) -> list[str | Path]:
    """Enter what is mounted; return the command that runs a plate's recipe."""
    data = deepcopy(PLATE)
    data["printer"] |= {"port": port.name, "profile": one.names["printer"]}
    data["printer"] |= {"syringe": "hamilton_1ml"}
    data["scan"] = {name: value for name, value in SCAN.items() if name != "="}
    if change is not None:
        change(data)
    write_network_csv(one.folder / "fork.csv", FORK)
    (one.folder / "recipe.yaml").write_text(yaml.safe_dump(data))
    one.mounted = {
        **{"syringe": "hamilton_1ml", "needle": "30g_50mm"},
        **{"ink": "gelatin_sacrificial", "bath": "cell_matrix", **mounted},
    }
    one.lengths = {"dish_centre_mm": (100.0, 100.0), "bath_depth_mm": 6.0}
    assert called(*one.mount_words(), cwd=one.folder).returncode == 0
    return ["run", one.folder / "recipe.yaml", "--yes", "--out", one.folder / "run"]


@pytest.mark.slow
def test_the_sound_plate_prints(sound: SetUpOnTest, port: PtyPrinter) -> None:
    done = called(*plate_words(sound, port, {}), cwd=sound.folder)
    assert "later.tif: no such scan" in done.stderr
    assert sound.extruded


_QUICK_PLATES = ("a dish in the plate's place", "bath neither named nor mounted")


@pytest.mark.parametrize("fault", cases(PLATE_FAULTS, _QUICK_PLATES))
def test_a_plate_refuses(fault: str, sound: SetUpOnTest, port: PtyPrinter) -> None:
    refused(sound, *plate_words(sound, port, *PLATE_FAULTS[fault]))


# --- the page's start


@dataclass
class Page:
    """A served workspace whose printer is connected."""

    folder: Path
    client: TestClient
    station: Station
    fake: FakeMarlin

    def call(self, method: str, path: str, **more: Any) -> Any:
        """Ask the API; give status and answer."""
        answer = self.client.request(method, f"/api/v1{path}", **more)
        return answer.status_code, answer.json()

    def started(self, one: SetUpOnTest, name: str) -> tuple[int, Any]:
        """Mount, put the tip to the start, fill in the form, start."""
        station, there = self.station, one.mounted
        bare = dict.fromkeys(("syringe", "needle", "ink", "bath", "dish"), "")
        station.mount(**bare, plunger_mm=None)
        used = {"plunger_mm": one.used_mm} if "syringe" in there else {}
        station.mount(**there, **used, **(one.lengths if "dish" in there else {}))
        station.set_position(100.0, 100.0, 5.0)
        if {"needle", "dish"} <= set(there):
            station.mount(floor_mm=0.0)
        file = {"file": (f"{name.replace(' ', '_')}.gcode", one.save().read_bytes())}
        job = self.call("POST", "/jobs", files=file)[1]["id"]
        code, form = self.call("GET", f"/jobs/{job}/form")
        assert code == 200
        if one.named:
            changed = {**form["set_up"], **one.named}
            assert self.call("PUT", f"/jobs/{job}/set-up", json=changed)[0] == 200
        ticked = {point["id"]: True for point in form["checklist"]}
        self.call("PATCH", f"/jobs/{job}/record", json={"operator": "Ada", "ticked": ticked})
        confirmed = {"confirmed": form["machine"]["words"]}
        return self.call("POST", f"/prints/{job}/start", json=confirmed)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    folder = tmp_path_factory.mktemp("workspace")
    with pytest.MonkeyPatch.context() as patch, pty_printer(FakeMarlin()) as port:
        patch.setenv("PRINTCTL_DATA", str(folder / "data"))
        one = SetUpOnTest(folder, port.printer)
        app = served(folder)
        station = connect(one.names["printer"], port.name, app.core.workspace.station)
        try:
            with app.client() as client:
                client.headers["Authorization"] = f"Bearer {app.access.token}"
                yield Page(folder, client, station, port.printer)
        finally:
            shut(station)


_AT_CONNECTING = ("other steps in the firmware", "other firmware")
_QUICK_PAGE = (
    *(
        "other syringe",
        "needle contradicts",
        "ink edited",
        "file without a record",
        "job in inches",
    ),
    *("job in micrometres", "nearly empty syringe", "dish elsewhere", "bath unknown"),
    *("dish unknown", "job in inches"),
)


@pytest.mark.parametrize(
    "fault", cases([one for one in FAULTS if one not in _AT_CONNECTING], _QUICK_PAGE)
)
def test_the_page_refuses(fault: str, page: Page) -> None:
    one = SetUpOnTest(page.folder, page.fake)
    FAULTS[fault](one)
    code, said = page.started(one, fault)
    assert code == 409, said
    assert said["message"].startswith("the print isn't started: ")
    assert not one.extruded


def test_the_page_prints_the_sound_job_also_where_a_person_says_that_nothing_is_there(
    page: Page,
) -> None:
    one = SetUpOnTest(page.folder, page.fake)
    FAULTS["bath unknown"](one)
    one.named["bath"] = "none"
    code, said = page.started(one, "no bath")
    assert code == 200, said
    wait_for(lambda: len(one.extruded) == 40)
