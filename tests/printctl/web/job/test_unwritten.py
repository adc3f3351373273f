"""Print on a full disk: state reported, end recorded later."""

from __future__ import annotations

import errno
import logging
import os
import time

import pytest

from printctl.machine.link.journal import Journal
from printctl.machine.link.record import JOURNAL, LinkRecord
from printctl.machine.link.states import LinkState, Status
from printctl.web.job.service import JobService
from tests.printctl.web.job.conftest import add


def ended(service: JobService) -> tuple[str, str]:
    """Leave a print that is over and whose end isn't noted; give its job and record."""
    job = add(service)
    folder = service.core.workspace.print_folder(job)
    folder.mkdir(parents=True)
    journal = Journal(folder / JOURNAL)
    journal.add("job", name=job, path="", sha256="", lines=1, started=time.time())
    journal.close()
    status = Status(LinkState.DONE).to_dict()
    LinkRecord(0, "", "", "", "generic_marlin", "p", time.time(), status=status).save(folder)
    record = service.records.current(job)
    service.records.mark(record, "one", started=time.time())
    return job, record


def test_state_is_told_though_its_end_can_t_be_noted(
    service: JobService, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    job, record = ended(service)
    write = service.records.mark

    def full(*asked: object, **more: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(service.records, "mark", full)
    with caplog.at_level(logging.ERROR):
        for _ in range(3):
            heard = service.heard(job)
            assert heard is not None
            assert heard.status.state is LinkState.DONE
    assert len([one for one in caplog.records if "can't be noted" in one.message]) == 1
    space_came = time.time()
    monkeypatch.setattr(service.records, "mark", write)
    service.heard(job)
    kept = service.records.load(record)
    assert kept["state"] == "done"
    assert kept["ended"] < space_came
