"""Fuzzing of the REST API by its own description: no server errors.

Half a minute long, so it runs with `make test-browser`, beside the tests that want Chromium.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from printctl.link import LinkError
from printctl.station import attach
from tests.printctl.web.serving import Process, server_process
from tests.slower import first_of

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Any:
    workspace = tmp_path_factory.mktemp("api") / "workspace"
    with server_process(workspace, "--sim-speed", "0") as server:
        yield server
    with contextlib.suppress(LinkError):  # what was sent may have connected the simulated printer
        attach(workspace / "station").close()


@pytest.mark.parametrize("examples", first_of([2, 30]))
def test_no_request_by_the_description_is_a_server_error(served: Process, examples: int) -> None:
    schemathesis = pytest.importorskip("schemathesis")
    hypothesis = pytest.importorskip("hypothesis")
    token = {"Authorization": f"Bearer {served.token}"}
    schema = schemathesis.openapi.from_url(f"{served.url}/api/v1/openapi.json", headers=token)
    failed: list[str] = []
    answered: Counter[int] = Counter()
    operations = [found.ok() for found in schema.get_all_operations()]
    assert len(operations) > 5

    def tried(operation: Any) -> None:
        @hypothesis.settings(
            max_examples=examples,
            deadline=None,
            derandomize=True,
            database=None,
            suppress_health_check=list(hypothesis.HealthCheck),
        )
        @hypothesis.given(case=operation.as_strategy())
        def send(case: Any) -> None:
            answer = case.call(headers=token, timeout=30)
            answered[answer.status_code] += 1
            if answer.status_code >= 500:
                failed.append(f"{operation.method} {case.path} {case.body!r}: {answer.text[:200]}")

        send()

    for operation in operations:
        tried(operation)
    assert failed == []
    assert answered[200] > 0
    assert answered[401] == 0


def test_the_description_is_whole(served: Process, tmp_path: Path) -> None:
    """Each route has a summary, an answer for refusals, and no name twice."""
    import httpx

    token = {"Authorization": f"Bearer {served.token}"}
    described = httpx.get(f"{served.url}/api/v1/openapi.json", headers=token).json()
    operations = [
        (f"{method} {path}", one)
        for path, item in described["paths"].items()
        for method, one in item.items()
    ]
    assert [name for name, one in operations if not one.get("summary")] == []
    assert [name for name, one in operations if "401" not in one["responses"]] == []
    ids = Counter(one["operationId"] for _, one in operations)
    assert [name for name, count in ids.items() if count > 1] == []
