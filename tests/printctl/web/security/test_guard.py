"""Access guard, tried on every route that changes something."""

import logging
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient, WebSocketDenialResponse
from starlette.websockets import WebSocketDisconnect

from printctl.web.controls import Principal
from printctl.web.security.bodies import BodyLimits
from printctl.web.security.redaction import scrubbed
from tests.printctl.web.serving import PAGE, Served, served
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
    token = {"Authorization": f"Bearer {here.gate.token}"}
    assert here.client().post("/api/v1/controls", headers=token).status_code == 200
    assert here.client().post("/api/v1/controls", headers=token | FOREIGN).status_code == 403


def test_a_visit_on_the_loopback_gets_a_session(unchanged: Served) -> None:
    client = unchanged.client()
    cookie = client.get("/printer").headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert "Secure" not in cookie
    answer = client.post("/api/v1/controls", headers=OURS)
    assert answer.status_code == 200
    assert answer.json()["holder"]["id"] == answer.json()["you"]["id"]


def test_the_cookie_is_secure_under_tls(tmp_path: Path) -> None:
    there = served(tmp_path, tls_cert=Path("c.pem"), tls_key=Path("k.pem"))
    client = there.client(base="https://127.0.0.1:8080")
    assert "; Secure" in client.get("/printer").headers["set-cookie"]


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", ""]
)
def test_a_name_that_was_made_to_point_here_is_refused(unchanged: Served, host: str) -> None:
    for path in ("/printer", "/login", "/api/v1/health", "/static/shell/stop.js"):
        assert unchanged.client().get(path, headers={"Host": host}).status_code == 421


@pytest.mark.parametrize("host", ["localhost:8080", "127.0.0.1:8080", "[::1]:8080", "localhost"])
def test_the_loopback_s_own_names_are_taken(unchanged: Served, host: str) -> None:
    assert unchanged.client().get("/api/v1/health", headers={"Host": host}).status_code == 200


def test_an_address_of_the_network_is_no_host_of_the_loopback(unchanged: Served) -> None:
    assert unchanged.client().get("/login", headers={"Host": "10.0.0.7:8080"}).status_code == 421


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


def test_a_forged_cookie_is_no_session(here: Served) -> None:
    client = visited(here)
    name, value = next(iter(client.cookies.items()))
    for bad in (value[:-1] + ("0" if value[-1] != "0" else "1"), "", "x", value.replace(".", "")):
        forger = here.client()
        forger.cookies.set(name, bad)
        assert forger.get("/api/v1/controls").status_code == 401


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


@pytest.mark.parametrize("way", ["//evil.example", "https://evil.example", "/\\evil", "/a\r\nb"])
def test_log_in_never_leads_to_another_server(locked: Served, way: str) -> None:
    form = {"password": "right", "next": way}
    entered = locked.client().post("/login", data=form, headers=OURS)
    assert entered.headers["location"] == "/printer"


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


def test_guessing_from_many_addresses_is_slowed_overall(tmp_path: Path) -> None:
    there = served(tmp_path, host="0.0.0.0", password="right")
    for n in range(30):
        client = there.client(address=f"10.0.1.{n}")
        assert client.post("/login", data={"password": "no"}, headers=OURS).status_code == 401
    late = there.client(address="10.0.2.1")
    assert late.post("/login", data={"password": "right"}, headers=OURS).status_code == 429


def test_guessing_tokens_is_slowed_and_the_right_one_never_waits(
    here: Served,
) -> None:
    inside = visited(here)
    for _ in range(5):
        wrong = here.client().post("/api/v1/stop", headers={"Authorization": "Bearer no"})
        assert wrong.status_code == 401
    wrong = here.client().post("/api/v1/stop", headers={"Authorization": "Bearer no"})
    assert wrong.status_code == 429
    assert int(wrong.headers["retry-after"]) > 0
    right = {"Authorization": f"Bearer {here.gate.token}"}
    assert here.client().post("/api/v1/stop", headers=right).status_code == 200
    assert here.client().get(f"/printer?token={here.gate.token}").status_code == 303
    assert inside.post("/api/v1/stop", headers=OURS).status_code == 200


def test_the_token_s_link_lets_a_browser_in_and_leaves_the_address(tmp_path: Path) -> None:
    there = served(tmp_path, token_link=True)
    client = there.client()
    assert client.get("/printer").status_code == 303
    assert client.get("/printer?token=no").status_code == 401
    entered = client.get(f"/printer?a=1&token={there.gate.token}")
    assert (entered.status_code, entered.headers["location"]) == (303, "/printer?a=1")
    assert client.get("/printer").status_code == 200


def test_a_session_ends_when_nothing_is_heard_and_is_renewed_when_something_is(
    here: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = visited(here)
    start = here.gate.sessions.clock()
    monkeypatch.setitem(here.gate.sessions.__dict__, "clock", lambda: start + 3600.0)
    renewed = client.get("/api/v1/controls")
    assert renewed.status_code == 200
    assert "set-cookie" in renewed.headers
    monkeypatch.setitem(here.gate.sessions.__dict__, "clock", lambda: start + 14 * 3600.0)
    assert client.get("/api/v1/controls").status_code == 401


def test_every_answer_has_its_security_headers(unchanged: Served) -> None:
    for path in ("/printer", "/login", "/api/v1/health", "/api/v1/none", "/static/shell/stop.js"):
        headers = unchanged.client().get(path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "same-origin"
        assert headers["cross-origin-opener-policy"] == "same-origin"
        policy = headers["content-security-policy"]
        assert "frame-ancestors 'none'" in policy
        assert "default-src 'none'" in policy
        assert "'unsafe-inline'" not in policy.split("script-src")[1].split(";")[0]


def test_the_page_s_scripts_have_the_nonce_of_its_policy(unchanged: Served) -> None:
    answer = unchanged.client().get("/printer")
    nonce = answer.text.split('nonce="')[1].split('"')[0]
    assert f"'nonce-{nonce}'" in answer.headers["content-security-policy"]
    assert nonce not in unchanged.client().get("/printer").text


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
    limits = unchanged.guard.limits
    for path in ("/api/v1/jobs", "/api/v1/prints/file~a.gcode/photos", "/api/v1/scans"):
        assert limits.limit(path) == 4_000_000_000, path
    for path in ("/api/v1/controls", "/api/v1/prints/a/b/photos", "/login", "/api/v1/jobs/x"):
        assert limits.limit(path) == 2_000_000, path


def test_an_upload_s_limit_below_that_of_other_requests_counts(unchanged: Served) -> None:
    limits = BodyLimits(unchanged.app.openapi, 1_000_000)
    assert limits.exceeded("/api/v1/jobs", 1_000_001)
    assert not limits.exceeded("/api/v1/jobs", 1_000_000)
    assert not limits.exceeded("/api/v1/controls", 2_000_000)


def test_what_is_small_waits_for_no_description() -> None:
    def described() -> dict[str, Any]:
        raise AssertionError("takes half a second")

    assert not BodyLimits(described, 4_000_000).exceeded("/api/v1/jobs", 2_000_000)


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
    for secret in ("guess", "bath and needle", there.gate.token):
        assert secret not in scrubbed(caplog.text)
    assert there.gate.token not in repr(there.gate)
    assert "bath" not in repr(there.core.settings) + repr(there.gate)


@pytest.mark.parametrize(
    "line",
    ['GET /?token=abc HTTP/1.1', "Authorization: Bearer abc", "password=abc&x=1",
     "cookie: printctl_8080=abc; a=b"],
)  # fmt: skip
def test_secrets_are_taken_out_of_log_lines(line: str) -> None:
    assert "abc" not in scrubbed(line)
    assert "***" in scrubbed(line)
