"""Access guard, tried on every route that changes something."""

import io
import logging
import os
import threading
from collections.abc import Callable
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient, WebSocketDenialResponse
from starlette.websockets import WebSocketDisconnect

from printctl.machine.records.actor import actor
from printctl.web.controls import Principal
from printctl.web.errors import ConflictError
from printctl.web.job.jobs import add_job
from printctl.web.security import login
from printctl.web.security.access import LIFETIME_S
from printctl.web.security.uploads import UPLOADS
from printctl.web.serving.serve import scrubbed
from tests.printctl.web.serving import PAGE, Served, served, session_cookie
from tests.slower import first_of

CHANGING = ("post", "put", "patch", "delete")
EVENTS = "ws://127.0.0.1:8080/api/v1/events"
OURS = {"Origin": PAGE}
FOREIGN = {"Origin": "http://evil.example"}


@pytest.fixture
def here(tmp_path: Path) -> Served:
    return served(tmp_path)


@pytest.fixture(scope="module")
def unchanged(tmp_path_factory: pytest.TempPathFactory) -> Served:
    """One for all tests that leave it as it is."""
    return served(tmp_path_factory.mktemp("unchanged"))


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory) -> Served:
    """One with a password, for tests that leave it as it is."""
    return served(tmp_path_factory.mktemp("locked"), password="right")


def changing_routes(here: Served) -> list[tuple[str, str]]:
    paths = here.app.openapi()["paths"]
    found = [(method, path) for path, item in paths.items() for method in item]
    return [(method, path) for method, path in found if method in CHANGING]


def visited(here: Served, **of: str) -> TestClient:
    client = here.client(**of)
    assert client.get("/printer").status_code == 200
    return client


def test_every_changing_route_is_refused_without_session_or_token(unchanged: Served) -> None:
    routes = changing_routes(unchanged)
    assert ("post", "/api/v1/stop") in routes
    for method, path in routes:
        answer = unchanged.client().request(method, path, headers=OURS)
        assert answer.status_code == 401, (method, path)
        assert answer.json()["error"] == "NotAllowedError"


ELSEWHERE = (
    FOREIGN,
    {"Origin": "null"},
    {"Origin": "http://127.0.0.1:9999"},
    {"Origin": "https://127.0.0.1:8080"},
    {"Sec-Fetch-Site": "cross-site"},
    {"Sec-Fetch-Site": "same-site"},
    {},
)


@pytest.mark.parametrize("each", first_of([2, len(ELSEWHERE)]))
def test_every_changing_route_is_refused_from_another_origin(unchanged: Served, each: int) -> None:
    """By ``each`` of the ways to come from elsewhere: other ones for the next route."""
    client, ways = visited(unchanged), cycle(ELSEWHERE)
    for method, path in changing_routes(unchanged):
        for headers in islice(ways, each):
            answer = client.request(method, path, headers=headers)
            assert answer.status_code == 403, (method, path, headers)


def test_every_changing_route_is_refused_from_another_address(tmp_path: Path) -> None:
    there = served(tmp_path, host="0.0.0.0", password="bath and needle")
    client = there.client(address="192.168.1.77", base="http://192.168.1.5:8080")
    assert client.get("/printer").headers["location"] == "/login?next=%2Fprinter"
    for method, path in changing_routes(there):
        answer = client.request(method, path, headers={"Origin": "http://192.168.1.5:8080"})
        assert answer.status_code == 401, (method, path)


def test_a_token_from_another_origin_is_refused(here: Served) -> None:
    token = {"Authorization": f"Bearer {here.access.token}"}
    assert here.client().post("/api/v1/controls", headers=token).status_code == 200
    assert here.client().post("/api/v1/controls", headers=token | FOREIGN).status_code == 403


def test_a_visit_on_the_loopback_gets_a_session(unchanged: Served) -> None:
    client = unchanged.client()
    cookie = client.get("/printer").headers["set-cookie"].lower()
    assert cookie.startswith("printctl_8080=")
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert "secure" not in cookie
    answer = client.post("/api/v1/controls", headers=OURS)
    assert answer.status_code == 200
    assert answer.json()["holder"]["id"] == answer.json()["you"]["id"]


def test_the_cookie_is_secure_under_tls(tmp_path: Path) -> None:
    there = served(tmp_path, tls_cert=Path("c.pem"), tls_key=Path("k.pem"))
    client = there.client(base="https://127.0.0.1:8080")
    assert "; secure" in client.get("/printer").headers["set-cookie"].lower()


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "", "localhost.",
     "0.0.0.0:8080", "10.0.0.7:8080", "localhost@evil.example", "[::ffff:10.0.0.7]", "127.1",
     "localhost, evil"],
)  # fmt: skip
def test_a_name_that_was_made_to_point_here_is_refused(unchanged: Served, host: str) -> None:
    for path in ("/printer", "/login", "/api/v1/health", "/static/page/stop.js"):
        assert unchanged.client().get(path, headers={"Host": host}).status_code == 421


@pytest.mark.parametrize("host", ["localhost:8080", "127.0.0.1:8080", "[::1]:8080", "localhost"])
def test_the_loopback_s_own_names_are_taken(unchanged: Served, host: str) -> None:
    assert unchanged.client().get("/api/v1/health", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize("name", ["Host", "Origin", "Authorization", "Cookie"])
def test_a_header_that_decides_and_comes_twice_is_refused(unchanged: Served, name: str) -> None:
    value = {"Host": "127.0.0.1:8080", "Origin": PAGE}.get(name, "x")
    twice = [("Host", "127.0.0.1:8080"), *[(name, value)] * (1 if name == "Host" else 2)]
    answer = unchanged.client().get("/api/v1/health", headers=twice)
    assert answer.status_code == 400
    assert f"{name.lower()} comes twice" in answer.json()["message"]


def test_a_refusal_that_a_library_writes_as_text_is_json(unchanged: Served) -> None:
    answer = unchanged.client().get("/static/page/stop.js", headers={"Range": "bytes=9-1"})
    assert (answer.status_code, answer.json()["error"]) == (400, "BadRequestError")
    assert "Range" in answer.json()["message"]


def test_a_page_of_another_origin_cannot_read(unchanged: Served) -> None:
    client = visited(unchanged)
    headers = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"}
    assert client.get("/api/v1/controls", headers=headers).status_code == 403


def test_a_link_from_elsewhere_is_asked_for_once_more_from_here(unchanged: Served) -> None:
    headers = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"}
    answer = unchanged.client().get('/printer?a="><script>', headers=headers)
    assert "set-cookie" not in answer.headers
    assert 'http-equiv="refresh"' in answer.text
    assert "<script" not in answer.text
    elsewhere = unchanged.client().get("http://127.0.0.1:8080//evil.example/x", headers=headers)
    assert "url=/evil.example/x" in elsewhere.text


def test_a_websocket_wants_our_origin_and_a_session(here: Served) -> None:
    with visited(here) as client:
        for headers in (FOREIGN, {}, {"Origin": "null"}):
            with (
                pytest.raises((WebSocketDisconnect, WebSocketDenialResponse)),
                client.websocket_connect(EVENTS, headers=headers),
            ):
                pass
        with client.websocket_connect(EVENTS, headers=OURS) as socket:
            assert socket.receive_json()["event"] in ("alive", "controls", "station", "print")
    with (
        pytest.raises((WebSocketDisconnect, WebSocketDenialResponse)),
        here.client().websocket_connect(EVENTS, headers=OURS),
    ):
        pass


def test_log_out_ends_the_session_and_its_websockets(here: Served) -> None:
    with visited(here) as client:
        kept = dict(client.cookies)
        with client.websocket_connect(EVENTS, headers=OURS) as socket:
            assert client.post("/logout", headers=OURS).status_code == 303
            with pytest.raises(WebSocketDisconnect):
                for _ in range(100):
                    socket.receive_json()
        again = here.client()
        again.cookies.update(kept)
        assert again.get("/api/v1/controls").status_code == 401


def sessionless(here: Served, headers: dict[str, str]) -> bool:
    return here.client().get("/api/v1/controls", headers=headers).status_code == 401


def test_a_forged_or_stolen_cookie_is_no_session(here: Served, tmp_path: Path) -> None:
    good = session_cookie(here.access)
    assert not sessionless(here, good)
    value = good["Cookie"].split("printctl_8080=")[1]
    body, time, signature = value.split(".")
    flipped = f"{body}.{time}.{'B' if signature[0] == 'A' else 'A'}{signature[1:]}"
    other = served(tmp_path / "other")  # another program of ours, at another port
    stolen = session_cookie(other.access)["Cookie"].split("printctl_8080=")[1]
    later = f"{body}.{time[:-1]}{'B' if time[-1] == 'A' else 'A'}.{signature}"
    for bad in (flipped, later, f"{body}.{signature}", "", "x", "..", "null", stolen):
        assert sessionless(here, {"Cookie": f"printctl_8080={bad}"}), bad
    assert sessionless(here, {"Cookie": f"printctl_9999={value}"})
    assert sessionless(here, {"Cookie": f"printctl_8080={value}; printctl_8080=x"})


def test_another_password_voids_the_last_ones_sessions(tmp_path: Path) -> None:
    before = session_cookie(served(tmp_path, password="one").access)
    assert not sessionless(served(tmp_path, password="one"), before)
    assert sessionless(served(tmp_path, password="two"), before)


def test_the_password_lets_in_and_a_wrong_one_does_not(tmp_path: Path) -> None:
    there = served(tmp_path, password="bath and needle")
    client = there.client()
    wrong = client.post("/login", data={"password": "no"}, headers=OURS)
    assert wrong.status_code == 401
    assert "set-cookie" not in wrong.headers
    right = {"password": "bath and needle", "next": "/job"}
    entered = client.post("/login", data=right, headers=OURS)
    assert (entered.status_code, entered.headers["location"]) == (303, "/job")
    assert client.get("/api/v1/controls").status_code == 200


def test_the_name_given_at_log_in_is_who_asks(tmp_path: Path, monkeypatch) -> None:
    there, asked = served(tmp_path, password="right"), []
    client = there.client()
    take = there.core.controls.take
    monkeypatch.setattr(
        there.core.controls, "take", lambda *given, **more: asked.append(actor()) or take(*given)
    )
    client.post("/login", data={"password": "right", "user": " Ada \n L. "}, headers=OURS)
    assert client.post("/api/v1/controls", headers=OURS).json()["holder"]["user"] == "Ada L."
    [one] = asked
    assert one["who"] == "Ada L."
    assert one["from"].startswith("page, Ada L., a browser at ")


@pytest.mark.parametrize("way", ["//evil.example", "https://evil.example", "/\\evil", "/a\r\nb"])
def test_log_in_never_leads_to_another_server(locked: Served, way: str) -> None:
    form = {"password": "right", "next": way}
    entered = locked.client().post("/login", data=form, headers=OURS)
    assert entered.headers["location"] == "/"


def test_log_in_from_another_origin_is_refused(locked: Served) -> None:
    assert locked.client().post("/login", data={"password": "right"}).status_code == 403
    answer = locked.client().post("/login", data={"password": "right"}, headers=FOREIGN)
    assert answer.status_code == 403


def test_guessing_is_slowed_per_address_and_others_still_come_in(tmp_path: Path) -> None:
    there = served(tmp_path, host="0.0.0.0", password="right")
    guesser = there.client(address="10.0.0.66")
    for _ in range(5):
        assert guesser.post("/login", data={"password": "no"}, headers=OURS).status_code == 401
    slowed = guesser.post("/login", data={"password": "right"}, headers=OURS)
    assert slowed.status_code == 429
    assert 0 < int(slowed.headers["retry-after"]) <= 60
    other = there.client(address="10.0.0.4")
    assert other.post("/login", data={"password": "right"}, headers=OURS).status_code == 303


def test_guessing_from_many_addresses_locks_nobody_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits = []

    async def sleep(seconds: float) -> None:
        waits.append(seconds)

    monkeypatch.setattr(login, "sleep", sleep)
    there = served(tmp_path, host="0.0.0.0", password="right")
    for n in range(login.MANY):
        client = there.client(address=f"10.0.1.{n}")
        assert client.post("/login", data={"password": "no"}, headers=OURS).status_code == 401
    assert waits == []
    late = there.client(address="10.0.2.1")
    assert late.post("/login", data={"password": "right"}, headers=OURS).status_code == 303
    assert waits == [login.BRAKE_S]


def test_wrong_tokens_keep_the_right_one_from_nothing(here: Served) -> None:
    inside = visited(here)
    for _ in range(40):
        wrong = here.client().post("/api/v1/stop", headers={"Authorization": "Bearer no"})
        assert wrong.status_code == 401
    right = {"Authorization": f"Bearer {here.access.token}"}
    assert here.client().post("/api/v1/stop", headers=right).status_code == 200
    assert here.client().get(f"/printer?token={here.access.token}").status_code == 303
    assert inside.post("/api/v1/stop", headers=OURS).status_code == 200


def test_the_token_s_link_lets_a_browser_in_and_leaves_the_address(tmp_path: Path) -> None:
    there = served(tmp_path, token_link=True)
    client = there.client()
    assert client.get("/printer").status_code == 303
    assert client.get("/printer?token=no").status_code == 401
    entered = client.get(f"/printer?a=1&token={there.access.token}")
    assert (entered.status_code, entered.headers["location"]) == (303, "/printer?a=1")
    assert client.get("/printer").status_code == 200
    again = client.get(f"/printer?a=1&token={there.access.token}")
    assert (again.status_code, again.headers["location"]) == (303, "/printer?a=1")


def test_a_session_ends_when_nothing_is_heard_and_is_renewed_when_something_is(
    unchanged: Served,
) -> None:
    old = session_cookie(unchanged.access, LIFETIME_S - 60.0)
    renewed = unchanged.client().get("/api/v1/controls", headers=old)
    assert renewed.status_code == 200
    assert "set-cookie" in renewed.headers
    assert sessionless(unchanged, session_cookie(unchanged.access, LIFETIME_S + 60.0))


def test_every_answer_has_its_security_headers(unchanged: Served) -> None:
    for path in ("/printer", "/login", "/api/v1/health", "/api/v1/none", "/static/page/stop.js"):
        headers = unchanged.client().get(path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "same-origin"
        assert headers["cross-origin-opener-policy"] == "same-origin"
        policy = headers["content-security-policy"]
        assert "frame-ancestors 'none'" in policy
        assert "default-src 'none'" in policy
        assert "script-src 'self';" in policy  # no script within a page runs


def test_a_request_that_is_too_large_is_refused_early_and_in_its_course(unchanged: Served) -> None:
    client = visited(unchanged)
    said = client.post("/api/v1/controls", content=b"x" * 2_000_001, headers=OURS)
    assert said.status_code == 413
    unsaid = client.post(
        "/api/v1/controls", content=(b"x" * 100_000 for _ in range(30)), headers=OURS
    )
    assert unsaid.status_code == 413
    assert "2 MB" in unsaid.json()["message"]


def test_what_takes_files_takes_large_ones_and_nothing_else_does(unchanged: Served) -> None:
    def takes_file(item: dict[str, Any]) -> bool:
        bodies = [one.get("requestBody", {}).get("content", {}) for one in item.values()]
        return any("multipart/form-data" in body for body in bodies)

    paths = unchanged.app.openapi()["paths"]
    for path, item in paths.items():
        assert bool(UPLOADS.fullmatch(path)) == takes_file(item), path
    for path in ("/api/v1/prints/a/b/photos", "/login", "/api/v1/jobs/", "/x/api/v1/jobs"):
        assert not UPLOADS.fullmatch(path), path


@pytest.fixture
def send(tmp_path: Path) -> Callable[[str, bytes], int]:
    """Give what uploads a G-code file of at most 1 MB; the status."""
    here = served(tmp_path, upload_mb=1.0)

    def sent(name: str, content: bytes) -> int:
        client = here.client()
        client.headers["Authorization"] = f"Bearer {here.access.token}"
        return client.post("/api/v1/jobs", files={"file": (name, content)}).status_code

    return sent


def uploaded(folder: Path) -> list[str]:
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*.gcode*") if p.is_file())


@pytest.mark.parametrize(
    ("name", "kept"),
    [("../a.gcode", "a"), ("/etc/a.gcode", "a"), ("a/b.gcode", "b"), ("..\\a.gcode", "a"),
     (".a.gcode", "a"), ("C:a.gcode", "C_a"), ("<script>.gcode", "script_"), ("a..gcode", "a"),
     ("x" * 70 + ".gcode", "x" * 58), ("a.gcode\0.gcode", "a.gcode_00")],
)  # fmt: skip
def test_a_name_that_could_lead_elsewhere_becomes_one_that_cant(
    tmp_path: Path, send: Callable[[str, bytes], int], name: str, kept: str
) -> None:
    assert send(name, b"G1 X1\n") == 200
    assert uploaded(tmp_path) == [f"jobs/{kept}.gcode"]


@pytest.mark.parametrize("name", ["a.sh", "a.gcode\0.sh", "../.gcode", "a.gcode/"])
def test_a_name_that_is_no_g_code_s_is_refused(
    tmp_path: Path, send: Callable[[str, bytes], int], name: str
) -> None:
    assert send(name, b"G1 X1\n") == 422
    assert uploaded(tmp_path) == []


@pytest.mark.parametrize(
    ("content", "status"),
    [(b"G1 X1\n" * 170_000, 413), (b"", 422), (b"\x89PNG\r\n\x1a\n123", 422),
     (b"MZ\x90\x00\x03", 422), (b"\xff\xfea", 422), (b"G1\n" * 200 + b"\0", 422)],
)  # fmt: skip
def test_what_is_too_large_or_no_text_leaves_nothing_behind(
    tmp_path: Path, send: Callable[[str, bytes], int], content: bytes, status: int
) -> None:
    assert send("a.gcode", content) == status
    assert uploaded(tmp_path) == []


def test_a_link_that_leads_out_of_the_workspace_is_refused(tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    here = served(tmp_path / "workspace")
    root, client = here.core.workspace.root, visited(here)
    for name, path in {"a.yaml": "recipes/a.yaml", "a.gcode": "jobs/a.gcode"}.items():
        (outside / name).write_text("secret: 1\n")
        (root / path).symlink_to(outside / name)
    (root / "jobs" / "b.gcode").symlink_to(root / "recipes" / "b.gcode")
    (root / "recipes" / "b.gcode").write_text("G1 X1\n")
    for url in ("recipes/a", "jobs/file~a.gcode"):
        answer = client.get(f"/api/v1/{url}")
        assert answer.status_code == 422
        assert "leads outside the workspace" in answer.json()["message"]
    assert client.get("/api/v1/recipes").json() == []
    assert [job["name"] for job in client.get("/api/v1/jobs").json()] == ["b.gcode"]


def test_what_lies_in_the_workspace_and_is_no_file_hides_nothing_else(tmp_path: Path) -> None:
    here = served(tmp_path / "workspace")
    root, client = here.core.workspace.root, visited(here)
    folders = {"recipes": "yaml", "jobs": "gcode", "scans": "tif"}
    for folder, kind in folders.items():
        os.mkfifo(root / folder / f"pipe.{kind}")
        (root / folder / f"loop.{kind}").symlink_to(f"loop.{kind}")
        (root / folder / f"folder.{kind}").mkdir()
        (root / folder / os.fsdecode(b"M\xfcller." + kind.encode())).write_text("G1 X1\n")
        (root / folder / f"good.{kind}").write_text("G1 X1\n")
    (root / "runs" / "loop").symlink_to("loop")
    run = root / "runs" / "one"
    run.mkdir()
    (run / "report.html").symlink_to("/etc/passwd")
    for folder in ("recipes", "jobs", "scans", "runs"):
        answer = client.get(f"/api/v1/{folder}")
        assert answer.status_code == 200, answer.text
        assert folder == "runs" or "good" in answer.text
        assert "loop" not in answer.text
    assert client.get("/api/v1/recipes/pipe").status_code == 422
    assert client.get("/api/v1/runs/one/pages/report").status_code == 422
    unusable = here.core.workspace.unusable_names("jobs/*.gcode")
    assert unusable == ["jobs/M\\udcfcller.gcode"]


def test_a_file_that_is_there_stays(tmp_path: Path, send: Callable[[str, bytes], int]) -> None:
    first = ("; " + "x" * 509 + "µ\n").encode()  # the head that is looked at cuts a character
    assert [send("a.gcode", first), send("a.gcode", b"G1\n"), send("a.gcode", first)] == [
        200,
        409,
        200,
    ]
    assert (tmp_path / "jobs" / "a.gcode").read_bytes() == first


def test_of_a_slow_upload_and_a_quick_one_of_its_name_one_is_refused(here: Served) -> None:
    began, done = threading.Event(), threading.Event()

    class Slow(io.BytesIO):
        def read(self, size: int | None = -1) -> bytes:
            began.set()
            done.wait(10)
            return super().read(size)

    def slow() -> None:
        with pytest.raises(ConflictError):
            add_job(here.core.workspace, "a.gcode", Slow(b"G1 X1\n"), 1000)

    thread = threading.Thread(target=slow)
    thread.start()
    began.wait(10)
    add_job(here.core.workspace, "a.gcode", io.BytesIO(b"G1 X2\n"), 1000)
    done.set()
    thread.join(10)
    assert (here.core.workspace.root / "jobs" / "a.gcode").read_bytes() == b"G1 X2\n"


def test_the_controls_are_one_browser_s_and_can_be_taken_over(here: Served) -> None:
    first, second = visited(here), visited(here)
    assert first.post("/api/v1/controls", headers=OURS).status_code == 200
    held = second.post("/api/v1/controls", headers=OURS)
    assert held.status_code == 423
    assert "take it over" in held.json()["message"]
    taken = second.post("/api/v1/controls", json={"force": True}, headers=OURS)
    assert taken.json()["holder"]["id"] == taken.json()["you"]["id"]
    assert first.delete("/api/v1/controls", headers=OURS).json()["holder"] is not None
    assert second.delete("/api/v1/controls", headers=OURS).json()["holder"] is None


def test_errors_have_their_name_and_status(here: Served) -> None:
    client = visited(here)
    assert client.get("/api/v1/none").json()["error"] == "NotFoundError"
    wrong = client.post("/api/v1/controls", json={"force": "perhaps"}, headers=OURS)
    assert (wrong.status_code, wrong.json()["error"]) == (422, "BadRequestError")
    here.core.controls.take(Principal("another"))
    assert client.post("/api/v1/controls", headers=OURS).json()["error"] == "NotInControlError"


def test_no_secret_is_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    there = served(tmp_path, password="bath and needle")
    with caplog.at_level(logging.DEBUG):
        there.client().post("/login", data={"password": "my guess"}, headers=OURS)
        there.client().get("/printer", params={"token": "my guess"})
        there.client().get("/api/v1/controls", headers={"Authorization": "Bearer my-guess"})
    assert "wrong password from 127.0.0.1" in caplog.text
    for secret in ("guess", "bath and needle", there.access.token):
        assert secret not in scrubbed(caplog.text)
    cookie = session_cookie(there.access)["Cookie"]
    assert cookie[-20:] not in scrubbed(f"cookie: {cookie}; x=1")
    shown = repr(there.core.settings) + repr(there.access)
    for secret in ("bath", there.access.token, there.access.secret):
        assert secret not in shown
