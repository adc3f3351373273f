"""The page's door: a recipe and its files taken in, made and rehearsed as the page does it."""

from __future__ import annotations

import time
from pathlib import Path

import httpx
import yaml

from tests.printctl.web.serving import server_process
from tests.system.first_part.program import TIME_LIMIT_S, Outcome

ENDED = ("done", "failed", "interrupted")
REHEARSAL = ".rehearsal"


def run(recipe: Path) -> Outcome:
    """Run a recipe on the page as far as the judged rehearsal."""
    name = str(yaml.safe_load(recipe.read_text())["name"])
    workspace = recipe.parent / "workspace"
    files = [path for path in recipe.parent.iterdir() if path.suffix in (".stl", ".csv")]
    with server_process(workspace) as server:
        access = {"Authorization": f"Bearer {server.token}"}
        with httpx.Client(base_url=f"{server.url}/api/v1", headers=access, timeout=60) as page:
            for path in files:
                _send(page, "/recipes/files", files={"file": (path.name, path.read_bytes())})
            _send(page, "/recipes/import", files={"file": (f"{name}.yaml", recipe.read_bytes())})
            _send(page, f"/runs/{name}/start", json={})
            state, message = _ended(page, name)
            if state == "done":
                _send(page, f"/projects/{name}/rehearse", json={"speed": 0})
                name += REHEARSAL
                state, message = _ended(page, name)
    return Outcome(int(state != "done"), message, workspace / "runs" / name)


def _send(page: httpx.Client, path: str, **body: object) -> None:
    page.post(path, **body).raise_for_status()  # type: ignore[arg-type]


def _ended(page: httpx.Client, name: str) -> tuple[str, str]:
    limit = time.monotonic() + TIME_LIMIT_S
    while time.monotonic() < limit:
        found = page.get(f"/runs/{name}/progress").raise_for_status().json()
        if found["state"] in ENDED:
            return str(found["state"]), str(found["message"])
        time.sleep(0.5)
    raise TimeoutError(f"{name} is still going on")
