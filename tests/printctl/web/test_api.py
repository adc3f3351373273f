"""Fuzzing of the REST API by its own description: no server errors."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest

from printctl.machine.link import LinkError
from printctl.machine.station import attach
from tests.printctl.web.serving import PAGE, Served
from tests.printctl.web.serving import served as made
from tests.slower import first_of


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """The app behind its guard, in this process: a server's costs as much as all requests."""
    workspace = tmp_path_factory.mktemp("api") / "workspace"
    yield made(workspace, sim_speed=0.0)
    with contextlib.suppress(LinkError):  # what was sent may have connected the simulated printer
        attach(workspace / "station").close()


def by_token(served: Served) -> dict[str, str]:
    return {"Authorization": f"Bearer {served.access.token}"}


@pytest.mark.parametrize("examples", first_of([1, 30]))
def test_no_request_by_the_description_is_a_server_error(served: Served, examples: int) -> None:
    schemathesis = pytest.importorskip("schemathesis")
    hypothesis = pytest.importorskip("hypothesis")
    schema = schemathesis.openapi.from_dict(served.app.openapi())
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
            answer = case.call(base_url=PAGE, headers=by_token(served), app=served.guard)
            answered[answer.status_code] += 1
            if answer.status_code >= 500:
                failed.append(f"{operation.method} {case.path} {case.body!r}: {answer.text[:200]}")

        send()

    for operation in operations:
        tried(operation)
    assert failed == []
    assert answered[200] > 0
    assert answered[401] == 0


def test_the_description_is_whole(served: Served) -> None:
    """Each route has a summary, an answer for refusals, and no name twice."""
    described = served.client().get("/api/v1/openapi.json", headers=by_token(served)).json()
    operations = [
        (f"{method} {path}", one)
        for path, item in described["paths"].items()
        for method, one in item.items()
    ]
    assert [name for name, one in operations if not one.get("summary")] == []
    assert [name for name, one in operations if "401" not in one["responses"]] == []
    ids = Counter(one["operationId"] for _, one in operations)
    assert [name for name, count in ids.items() if count > 1] == []
