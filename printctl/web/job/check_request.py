"""Request to the process that checks a job, as JSON: G-code file, print set-up, table path."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from printctl.web.job.set_up import JobSetUp


@dataclass(frozen=True)
class Question:
    """Job and set-up to check.

    Attributes
    ----------
    gcode : Path
    set_up : JobSetUp
    table : Path
        Where the job's table goes.
    """

    gcode: Path
    set_up: JobSetUp
    table: Path

    def to_json(self) -> str:
        """One line of text that `from_json` reads."""
        set_up = self.set_up.model_dump(mode="json")
        return json.dumps({"gcode": str(self.gcode), "set_up": set_up, "table": str(self.table)})

    @staticmethod
    def from_json(text: str) -> Question:
        """Read `to_json`."""
        data = json.loads(text)
        set_up = JobSetUp.model_validate(data["set_up"])
        return Question(Path(data["gcode"]), set_up, Path(data["table"]))
