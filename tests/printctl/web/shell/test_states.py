"""Every state of every page passes axe and fits its screen, in each size and theme.

A state is an address, what is changed in the server's answers on their way (so that what takes
minutes or a broken machine is there at once), what is pressed, and a text that is seen then.
"""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import pytest

from printctl.machine.process.clients.starting import connect
from printctl.machine.process.contact import load_station
from printctl.recipe.load import STARTER
from printctl.web.workspace import Workspace
from tests.printctl.history.records.prints import printed, with_run
from tests.printctl.machine.link.layered import layered
from tests.printctl.web.scan.test_page import SAID, _registered, _volume
from tests.printctl.web.serving import Process, server_process
from tests.printctl.web.shell.browsers import serious
from tests.printctl.web.shell.looks import assert_alike
from tests.sim_process import printer_process
from tests.waiting import wait_for

pytestmark = pytest.mark.browser
DESKTOP, SMALL, PHONE = ((1280, 800), (1024, 768), (400, 800))
LOOKS = [(DESKTOP, "light"), (PHONE, "dark")]
ALL_LOOKS = [(size, theme) for size in (DESKTOP, SMALL, PHONE) for theme in ("light", "dark")]
JOB, PRINTED = "file~zigzag.gcode", "file~part.gcode"
START = (50.0, 50.0, 10.0)
REFUSED = {"error": "Internal", "message": "The server has failed; its log says why."}
CHECKS = [
    {"check": "lumen open", "passed": False, "refuses": True, "value": 0.02, "limit": 0.1,
     "unit": "mm", "place": "vessel 3", "remedy": "make the smallest vessels wider"},
    {"check": "ink left", "passed": False, "refuses": False, "value": 4.0, "limit": 5.0,
     "unit": "µL", "place": "whole part", "remedy": "fill another syringe"},
    {"check": "gap of lines", "passed": True, "refuses": True, "value": 0.3, "limit": 0.2,
     "unit": "mm", "place": "layer 2", "remedy": ""},
]  # fmt: skip
STAGES: list[dict[str, Any]] = [
    {"name": name, "state": state, "fraction": share, "note": note, "remarks": []}
    for name, state, share, note in (
        ("tissue", "done", 1, "unchanged since"), ("vasculature", "done", 1, "31 vessels"),
        ("print", "running", 0.4, "layer 3 of 9"), ("scan", "waiting", 0, ""),
    )
]  # fmt: skip
GOING = {"name": "first", "state": "running", "stages": STAGES, "message": "", "until": "print"}
FAILED = {**GOING, "state": "failed", "message": "vasculature: no room for 900 terminals"}
MADE = {"made": True, "step": "print", "checks": CHECKS[1:], "problems": [], "print_time_s": 420.0}
HALT = {"state": "halted", "message": "The printer has halted: M112", "state_words": "halted"}

SMALL_TARGETS = """[...document.querySelectorAll(
  "#content :is(button:not([aria-expanded]), .button, td a)")]
  .filter((one) => one.offsetParent).map((one) => [one.innerText, one.getBoundingClientRect()])
  .filter(([, box]) => box.height < 41.5 || box.width < 41.5).map(([text]) => text)"""
"""Words of what a glove would miss."""
DIALOG_TOP = """document.querySelector("[role=dialog]")?.getBoundingClientRect().y ?? innerHeight"""


@dataclass(frozen=True)
class State:
    """How a state is reached, by its name in the tests."""

    name: str
    at: str
    text: str
    answers: dict[str, Any] = field(default_factory=dict)
    """What is put into the JSON objects at these paths of the API; a number is a refusal."""
    station: dict[str, Any] = field(default_factory=dict)
    """What is put into the news of the printer."""
    press: tuple[str, ...] = ()
    world: str = "standing"
    """Which server: empty, standing (with a printer), mounted, printing or ended."""
    tall: bool = False
    """Whether it may be taller than two screens: forms of a recipe, the gallery on a phone."""


def project(name: str, at: str, text: str, /, **answer: Any) -> State:
    at = f"/project?name=first&step={at}"
    return State(f"project {name}", at, text, {"/projects/first": answer})


STATES = [
    State("home empty", "/", "Begin with one of these", world="empty", tall=True),
    State("printer unconnected", "/printer", "First connect a printer", world="empty"),
    State("job empty", "/job", "No job yet", world="empty"),
    State("design empty", "/design", "A recipe says what is printed", world="empty"),
    State("scan empty", "/scan", "Scan the part, then drop", world="empty"),
    State("history empty", "/history", "Nothing was printed here yet", world="empty"),
    State("home", "/", "Go on with", tall=True),
    project("shape", "shape", "grown in"),
    project("problems", "shape", "can't be used as it stands", problems=["tissue: size_mm is 0"]),
    project("not made", "check", "Not made yet"),
    project("making", "check", "layer 3 of 9", run=GOING),
    project("broken", "check", "It can't be made", run={**FAILED, "stages": [
        {**STAGES[0], "state": "failed", "note": "no room"}]}),
    project("checked", "check", "let it be printed", **MADE),
    project("refused", "check", "refuse the print", **MADE | {"checks": CHECKS}),
    project("print", "print", "Rehearse it", **MADE),
    project("rehearsing", "print", "Watch it print", **MADE, run=GOING),
    project("judge", "judge", "Nothing to judge yet", **MADE),
    project("scan it", "judge", "Take in a scan", **MADE, print_state="done"),
    project("judged", "judge", "isn't as designed", **MADE, has_report=True, judged="first",
            passed=False, reasons=["Vessel 7 is closed"]),
    State("design form", "/design?recipe=first", "Find a field", tall=True),
    State("design to mend", "/design?recipe=wrong", "to mend", tall=True),
    State("design text", "/design?recipe=first&tab=text", "ready to be made"),
    State("design make", "/design?recipe=first&tab=make", "Make the design",
          {"/runs/first/progress": GOING}),
    State("design failed", "/design?recipe=first&tab=make", "It failed.",
          {"/runs/first/progress": FAILED}),
    State("design look", "/design?recipe=first&tab=look", "Open in a tab"),
    State("design figures", "/design?recipe=first&tab=figures", "Files"),
    State("design new", "/design", "Begin from", press=("New",), tall=True),
    State("design import", "/design", "A file that recipes name", press=("Import",), tall=True),
    State("jobs", "/job?other=1", "Choose a job"),
    State("scan result", "/scan?scan=file~chip_7.tif", "Not passed"),
    State("scan vessels", "/scan?scan=file~chip_7.tif", "29 of 30 pass", press=("Vessels (30)",)),
    State("scan slices", "/scan?scan=file~chip_7.tif", "From above", press=("Slices",)),
    State("scan lacks", "/scan?scan=file~bare.tif", "doesn't say"),
    State("scan registering", "/scan?scan=file~chip_7.tif", "layer 3 of 9",
          {"/scans/file~chip_7.tif/with/chip/progress": GOING}, tall=True),
    State("scan delete", "/scan?scan=file~chip_7.tif", "what was found with it", press=("Delete",)),
    State("history", "/history", "4 prints"),
    State("history one", "/history?words=hostile", "What happened", press=("hostile",),
          tall=True),
    State("history verify", "/history", "Choose a record", press=("Verify a record",)),
    State("printer", "/printer", "What is mounted"),
    State("touch off", "/printer?tab=needle", "The floor needs"),
    State("console", "/printer?tab=console", "Nothing was typed yet"),
    State("calibration", "/printer?tab=calibration", "By the command line"),
    State("weigh", "/printer?tab=calibration", "Add a row",
          press=("Start: Flow by weight", "Add a row")),
    State("mount", "/printer?open=mount", "That is mounted"),
    State("syringe", "/printer?open=syringe", "It is up: next"),
    State("needle", "/printer?open=needle", "Tighten it", press=("It is up: next",)),
    State("homing", "/printer?open=home", "Home these axes"),
    State("place", "/printer?open=place", "The tip stands there"),
    State("macro", "/printer?tab=console", "Commands, one a line", press=("New macro",)),
    State("halted", "/printer", "The printer has halted", station=HALT),
    State("lost", "/printer", "The connection is lost", station={**HALT, "state": "lost"}),
    State("before", f"/job?job={JOB}", "checks passed", world="mounted"),
    State("before, open", f"/job?job={JOB}", "Extra ink after a pause",
          press=("Change what is mounted", "How the print is watched", "Record: operator"),
          world="mounted", tall=True),
    State("during", "/job", "Printing ·", world="printing"),
    State("during, cancel", "/job", "Yes, cancel it", press=("Cancel print",), world="printing"),
    State("printer locked", "/printer", "A print goes on", world="printing"),
    State("after", f"/job?job={PRINTED}", "What came out", world="ended"),
    State("after, open", f"/job?job={PRINTED}", "Allowed wall shear", world="ended",
          press=("Warm the bath slowly", "How hard the channels"), tall=True),
    *(
        State(f"failed {at} {path}", at, "Try again", {path: 500})
        for at, path in (
            ("/", "/projects"), ("/", "/gallery"), ("/project?name=first", "/projects/first"),
            ("/printer?tab=calibration", "/printer/calibrations"), ("/job?other=1", "/jobs"),
            (f"/job?job={JOB}", f"/jobs/{JOB}/form"), ("/job", "/prints/current"),
            ("/design", "/recipes"), ("/scan", "/scans"), ("/history", "/history"),
            ("/scan?scan=file~chip_7.tif", "/scans/file~chip_7.tif/said"),
            ("/history?print=none", "/history/none"),
        )
    ),
]  # fmt: skip

PICTURED = (
    "home empty", "project shape", "project checked", "project print", "design form",
    "scan result", "history", "printer", "before", "during", "after",
)  # fmt: skip
"""States whose pictures are compared with those of last time."""


class World:
    """Servers that states are of: each is begun when it is first needed, in the table's order."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.closing: list[Callable[[], Any]] = []
        self.servers: dict[str, Process] = {}
        self.prints = False

    def url(self, name: str) -> str:
        if name == "empty":
            return self.served(name, Workspace(self.folder / "empty").make)
        url = self.served("standing", self.standing)
        if name == "mounted":
            self.mount()
        if name == "printing" and not self.prints:
            self.begin()
        if name == "ended" and self.prints:
            self.rest("POST", f"/prints/{PRINTED}/cancel")
            wait_for(lambda: self.rest("GET", f"/prints/current?job={PRINTED}")["ended"])
            self.prints = False
        return url

    def served(self, name: str, make: Callable[[], Workspace]) -> str:
        if name not in self.servers:
            context = server_process(make().root)
            self.servers[name] = context.__enter__()
            self.closing.append(lambda: context.__exit__(None, None, None))
        return self.servers[name].url.rstrip("/")

    def rest(self, method: str, path: str, body: Any = None) -> Any:
        server = self.servers["standing"]
        headers = {"Authorization": f"Bearer {server.token}", "Content-Type": "application/json"}
        data = None if body is None else json.dumps(body).encode()
        url = f"{server.url.rstrip('/')}/api/v1{path}"
        with urlopen(Request(url, data, headers, method=method), timeout=60) as answer:
            return json.loads(answer.read() or b"null")

    def standing(self) -> Workspace:
        workspace = self.workspace = Workspace(self.folder / "standing").make()
        (workspace.root / "jobs" / "zigzag.gcode").write_bytes(layered(2, 20))
        recipes = workspace.root / "recipes"
        (recipes / "first.yaml").write_text(STARTER.read_text())
        (recipes / "wrong.yaml").write_text("schema: 1\nname: wrong\ntissue: {shape: block}\n")
        scans = workspace.root / "scans"
        for name in ("chip_7", "bare"):
            _volume(scans / f"{name}.tif")
        (scans / "chip_7.json").write_text(json.dumps(SAID))
        runs = workspace.root / "runs"
        _registered(runs / "chip" / ".registered" / "file~chip_7.tif")
        for k, end in enumerate(("done", "killed", "done")):
            printed(runs / f"print_{k}", "part.gcode", 1e9 + k, end)
        printed(runs / "hostile", "part.gcode", 2e9, message="<b>", alarm="<i>" * 30)
        with_run(runs / "hostile")
        (runs / "first").mkdir()
        start = ",".join(f"{mm:g}" for mm in START)
        printer = printer_process(self.folder, "--start", start, speed=2)
        port = printer.__enter__()
        self.closing.append(lambda: printer.__exit__(None, None, None))
        self.station = connect("generic_marlin", port, workspace.station)
        self.closing.append(self.end_station)
        self.station.set_position(*START)
        self.words = f"generic_marlin on {port}"
        return workspace

    def mount(self) -> None:
        parts = {"syringe": "hamilton_1ml", "ink": "collagen_fresh", "needle": "28g"}
        self.station.mount(**parts, bath="gelatin_support")

    def begin(self) -> None:
        self.prints = True
        self.mount()
        (self.workspace.root / "jobs" / "part.gcode").write_bytes(layered(20, 200))
        self.rest("POST", "/controls", {"force": True})
        self.rest("POST", f"/jobs/{PRINTED}/to-start", {})
        form = self.rest("GET", f"/jobs/{PRINTED}/form")
        self.rest("PUT", f"/jobs/{PRINTED}/set-up", form["set_up"] | {"dish": "none"})
        ticked = {one["id"]: True for one in form["checklist"]}
        self.rest("PATCH", f"/jobs/{PRINTED}/record", {"operator": "Ada", "ticked": ticked})
        self.rest("POST", f"/jobs/{PRINTED}/for-mounted", {})
        ready = f"/jobs/{PRINTED}/readiness"
        wait_for(lambda: self.rest("GET", ready)["ready"], 60)
        self.rest("POST", f"/prints/{PRINTED}/start", {"confirmed": self.words})
        self.rest("DELETE", "/controls")

    def end_station(self) -> None:
        if self.station.status.open:
            self.station.kill()
            os.kill(load_station(self.workspace.station).pid, signal.SIGKILL)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    folder = tmp_path_factory.mktemp("states")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PRINTCTL_DATA", str(folder / "data"))
        made = World(folder)
        yield made
        for close in reversed(made.closing):
            close()


def answered(page: Any, path: str, change: Any) -> None:
    """Have the API answer at a path by something else, or by its own with a change."""

    def answer(route: Any) -> None:
        if isinstance(change, int):
            route.fulfill(status=change, json=REFUSED)
            return
        response = route.fetch()
        body = response.json() if response.ok else {}
        route.fulfill(status=200, json=body | change)

    page.route(lambda url: url.partition("?")[0].endswith(f"/api/v1{path}"), answer)


def station_says(page: Any, change: dict[str, Any]) -> None:
    def connected(socket: Any) -> None:
        server = socket.connect_to_server()

        def heard(message: str) -> None:
            told = json.loads(message)
            socket.send(json.dumps(told | change if told["event"] == "station" else told))

        server.on_message(heard)

    page.route_web_socket("**/events", connected)
    answered(page, "/printer/status", change)


def looks_of(state: State) -> list[Any]:
    """In CI two looks at what is pictured, one at others; all looks in `make test-slow`."""
    once = LOOKS[STATES.index(state) % 2 :][:1]
    return [
        pytest.param(state, LOOKS if state.name in PICTURED else once, id=state.name),
        pytest.param(state, ALL_LOOKS, id=f"{state.name}-all", marks=pytest.mark.slow),
    ]


@pytest.mark.parametrize(("state", "looks"), [one for state in STATES for one in looks_of(state)])
def test_state_passes_axe_and_fits(
    world: World, browser: Any, state: State, looks: list[Any]
) -> None:
    url = world.url(state.world)
    page = browser.contexts[0].new_page()
    wrong: list[str] = []
    page.on("pageerror", lambda problem: wrong.append(str(problem)))
    for path, change in state.answers.items():
        answered(page, path, change)
    if state.station:
        station_says(page, state.station)
    page.goto(url + state.at)
    for words in state.press:
        page.locator("main").get_by_text(words).or_(
            page.get_by_role("button", name=words)
        ).first.click()
    page.get_by_text(state.text).first.wait_for()
    for (width, height), theme in looks:
        page.set_viewport_size({"width": width, "height": height})
        page.emulate_media(color_scheme=theme)
        page.wait_for_timeout(250)
        look = f"{state.name} at {width} in {theme}"
        assert serious(page) == [], look
        tall, wide = page.evaluate(
            "[document.documentElement.scrollHeight, document.documentElement.scrollWidth]"
        )
        assert wide <= width, look
        if not state.tall:
            assert tall <= (2000 if width == PHONE[0] else 1000), look
        if state.name == "during":
            assert tall <= height, look
        assert page.evaluate(SMALL_TARGETS) == [], look
        assert page.evaluate(DIALOG_TOP) >= page.locator(".header").bounding_box()["height"], look
    if state.name in PICTURED and looks is LOOKS:
        page.emulate_media(color_scheme="light")
        moving = "[role=application] *, main dd, #pc-print" if state.name == "during" else ""
        assert_alike(page, state.name.replace(" ", "_"), moving)
    assert wrong == []
