"""Looks of an observed print over the service and the API."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from printctl.machine.control.look_book import LookDecision
from printctl.observe.records import look_folder, read_answer, save_look
from printctl.web.errors import ConflictError, NotFoundError
from printctl.web.job.looks import AnswerRequest, LookReport
from printctl.web.workspace import Workspace
from tests.printctl.web.job.conftest import OPERATOR, OTHER
from tests.printctl.web.job.looks.held import JOB, picture, print_held_for_a_look, record
from tests.printctl.web.serving import PAGE, served, server_process
from tests.printctl.web.shell.browsers import WIDE, serious, shown
from tests.waiting import wait_for as until


def waiting(looks: list[LookReport]) -> list[LookReport]:
    """The looks, once the service has heard that the print is paused by one; else none."""
    return looks if looks[0].waits else []


def test_a_look_that_asks_is_answered_once_by_who_holds_the_controls(core, service):
    with print_held_for_a_look(core.workspace) as client:
        folder = core.workspace.print_folder(JOB)
        save_look(folder, record(2, at=1.0))  # of an earlier print in the same folder
        (found,) = until(lambda: waiting(service.looks.looks(JOB)))
        assert found.proposed == "write again what is missing, flow factor 1.06"
        assert found.outcome == "asks to write again what is missing"
        core.controls.take(OTHER)
        with pytest.raises(Exception, match="Grace holds the controls"):
            service.looks.answer(OPERATOR, JOB, 1, AnswerRequest(answer="approve"))
        core.controls.release(OTHER)
        with pytest.raises(NotFoundError, match="no look 2"):
            service.looks.answer(OPERATOR, JOB, 2, AnswerRequest(answer="approve"))
        for _ in range(2):  # saying it twice does no harm
            said = service.looks.answer(OPERATOR, JOB, 1, AnswerRequest(answer="approve"))
            assert said.answer == "approve"
            assert not said.waits
        assert read_answer(folder, 1) == "approve"
        with pytest.raises(ConflictError, match="answered before: approve"):
            service.looks.answer(OPERATOR, JOB, 1, AnswerRequest(answer="go_on"))
        assert client.status.state == "paused"  # the observer acts, not the page


def test_an_answer_that_nobody_hears_is_refused(core, service):
    with print_held_for_a_look(core.workspace, observed=False):
        folder = core.workspace.print_folder(JOB)
        until(lambda: waiting(service.looks.looks(JOB)))
        with pytest.raises(ConflictError, match="no observer is at work"):
            service.looks.answer(OPERATOR, JOB, 1, AnswerRequest(answer="go_on"))
        service.hands.cancel(JOB)
        until(lambda: service.prints.heard(JOB).status.ended)
        with pytest.raises(ConflictError, match="isn't waiting for an answer to look 1"):
            service.looks.answer(OPERATOR, JOB, 1, AnswerRequest(answer="go_on"))
        assert read_answer(folder, 1) is None


def test_a_look_taken_anew_waits_for_a_new_answer(tmp_path: Path) -> None:
    save_look(tmp_path, record(1, "pause", "mend"))
    (look_folder(tmp_path, 1) / "answer.json").write_text('{"answer": "approve"}')
    assert read_answer(tmp_path, 1) == "approve"
    save_look(tmp_path, record(1, "pause", "flow"))
    assert read_answer(tmp_path, 1) is None


def test_looks_and_small_pictures_come_by_rest_and_answers_only_with_a_token(tmp_path: Path):
    app = served(tmp_path)
    with app.client() as client, print_held_for_a_look(app.core.workspace):
        place = f"/api/v1/prints/{JOB}/looks"
        assert client.get(place).status_code == 401
        said = client.post(
            f"{place}/1/answer", json={"answer": "approve"}, headers={"Origin": PAGE}
        )
        assert said.status_code == 401
        headers = {"Authorization": f"Bearer {app.access.token}", "Origin": PAGE}
        until(lambda: client.get(place, headers=headers).json()[0]["waits"])
        (look,) = client.get(place, headers=headers).json()
        assert (look["number"], look["asked"]) == (1, "mend")
        answer = client.get(f"{place}/1/picture?width=300", headers=headers)
        assert answer.headers["content-type"] == "image/jpeg"
        with Image.open(io.BytesIO(answer.content)) as small:
            assert small.width == 300
        picture(app.core.workspace.print_folder(JOB), 1, (600, 700))  # another in its place
        answer = client.get(f"{place}/1/picture", headers=headers)
        with Image.open(io.BytesIO(answer.content)) as small:
            assert small.size == (600, 700)
        assert client.get(f"{place}/2/picture", headers=headers).status_code == 404
        wrong = client.post(f"{place}/1/answer", json={"answer": "yes"}, headers=headers)
        assert wrong.status_code == 422
        said = client.post(f"{place}/1/answer", json={"answer": "go_on"}, headers=headers)
        assert said.status_code == 200, said.text
        assert said.json()["outcome"] == "gone on without"


# --- looks card of the Job page, in a real browser
@pytest.mark.browser
@pytest.mark.slow
def test_a_look_that_asks_is_shown_and_approved(browser: Any, tmp_path: Path) -> None:
    workspace = Workspace(tmp_path / "workspace").make()
    with print_held_for_a_look(workspace) as client, server_process(workspace.root) as server:
        folder = workspace.print_folder(JOB)
        page = shown(browser, f"{server.url}/job?job={JOB}", viewport=WIDE)
        page.get_by_text("Look 1 at the end of layer 1", exact=True).wait_for()
        page.get_by_text("Proposed: write again what is missing, flow factor 1.06").wait_for()
        whole = page.get_by_alt_text("Look 1: what was expected and what was found")
        assert whole.evaluate("one => one.decode().then(() => one.naturalWidth)") > 400
        page.get_by_text("Last looks").click()
        until(
            lambda: page.evaluate("document.querySelector('.job-strip img')?.naturalWidth === 240")
        )
        assert serious(page) == []
        page.screenshot(path=str(tmp_path / "looks.png"), full_page=True)
        page.get_by_role("button", name="Approve").click()
        page.get_by_text("Approved. If the print is still paused").wait_for()
        assert read_answer(folder, 1) == "approve"
        assert not page.get_by_role("button", name="Go on without").is_visible()
        client.resume()  # as the observer does
        page.get_by_text(": a picture is taken and judged").wait_for()
        page.get_by_text("1: mended, approved").wait_for()
        picture(folder, 2)
        save_look(folder, record(2))
        client.looks.decide(2, LookDecision.GO_ON, "as expected")
        page.get_by_text("2: gone on").wait_for()
