"""Syringe change reported to a print whose link process died beforehand."""

from __future__ import annotations

from pathlib import Path

import pytest

from printctl.errors import PrintctlError
from printctl.link.journal import Journal
from printctl.link.record import JOURNAL, LinkRecord
from printctl.link.states import LinkState
from printctl.print_state.continue_print import continue_print
from tests.printctl.link.jobs import parse_job
from tests.printctl.link.test_stop_in_waits import JOB


def broken_off(folder: Path, wanted: str) -> None:
    """Leave a print whose process was killed while the needle was being lifted."""
    file = folder / "a.gcode"
    file.write_text(JOB)
    job = parse_job(JOB.encode(), "a.gcode")
    LinkRecord(0, "", "", str(file), "generic_marlin", "/dev/nowhere", 0.0).save(folder)
    journal = Journal(folder / JOURNAL)
    journal.add("job", sha256=job.sha256, lines=len(job))
    journal.add("state", state=LinkState.PRINTING, message="printing")
    journal.add("wanted", after=wanted)
    journal.add("state", state=LinkState.PAUSING, message="lifting the needle")
    journal.add("ack", done=30)
    journal.close()


@pytest.mark.parametrize(
    ("wanted", "then"),
    [("reload", "the change asked for is made first"), ("", "`printctl reload RUN` makes room")],
)
def test_it_is_refused_with_the_way_to_change(tmp_path, wanted, then):
    broken_off(tmp_path, wanted)
    with pytest.raises(PrintctlError, match=r"wasn't held for a change of syringe") as refused:
        continue_print(tmp_path, plunger_mm=0.0)
    assert then in str(refused.value)
