"""Store of search results: a file per candidate, named by a hash of all that determines it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from design.files import write_text

FOLDER: Final = "candidates"


class Store:
    """The results in a search's folder.

    A file is there whole or not at all, so that a search can be killed at any time and goes on
    with what is missing. Results of other keys stay: a search file that is changed, and changed
    back, finds them again.
    """

    def __init__(self, out: Path) -> None:
        self._folder = out / FOLDER

    def path(self, key: str) -> Path:
        """Where a candidate's result is."""
        return self._folder / f"{key}.json"

    def read(self, key: str) -> dict[str, Any] | None:
        """A candidate's result as `evaluate` gave it; None where there is none to rely on."""
        try:
            record = json.loads(self.path(key).read_text(encoding="utf-8"))
            if isinstance(record["result"], dict) and record["result"].keys() & {
                "numbers",
                "refused",
            }:
                return dict(record["result"])
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return None

    def write(self, key: str, values: dict[str, Any], result: dict[str, Any]) -> None:
        """Keep a result; ``values`` tell a reader of the file which candidate it is."""
        text = json.dumps({"values": values, "result": result}, indent=1, allow_nan=False)
        write_text(self.path(key), text + "\n")
