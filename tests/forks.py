"""Run tests in forked workers that share one collection: ``pytest -p tests.forks --forks 3``.

To import and collect all tests takes twenty seconds of a core, and pytest-xdist does it in each
worker. Here it is done once, and each worker is a fork of what was collected. A file is the unit of
work, as with ``--dist loadfile``; files are handed out in the order of the collection, but a worker
ends a folder before it begins another. Tests in a browser have workers of their own,
``--browsers`` of them, until they are done; a file of them that failed beside others is tried once
more at the end, alone. A worker that dies fails the test it was
at; a new one does the rest.
"""

from __future__ import annotations

import gc
import os
import signal
from collections import deque
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from typing import Any

import pytest

Group = list[pytest.Item]


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("forks")
    group.addoption("--forks", type=int, default=0, help="number of forked workers")
    group.addoption(
        "--browsers", type=int, default=2, help="how many of them begin with browser tests"
    )


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session: pytest.Session) -> bool | None:
    """Take the place of pytest's own loop where workers are wanted and can be."""
    options = session.config.option
    if not options.forks or options.collectonly or session.testsfailed or not hasattr(os, "fork"):
        return None
    _Loop(session, options.forks, options.browsers).run()
    return True


def _in_browser(item: pytest.Item) -> bool:
    return item.get_closest_marker("browser") is not None


def _by_file(items: Group) -> list[Group]:
    files: dict[tuple[str, bool], Group] = {}
    for item in items:
        files.setdefault((str(item.path), _in_browser(item)), []).append(item)
    return list(files.values())


def _threads() -> int:
    tasks = "/proc/self/task"
    return len(os.listdir(tasks)) if os.path.isdir(tasks) else 1


STARTED: list[str] = []
"""The test file after which there were threads of numba or of a mesh library."""


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Generator[None, Any, Any]:
    """Remember the first file that starts threads as it is collected."""
    report = yield
    if not STARTED and _threads() > 1:
        STARTED.append(collector.nodeid)
    return report


def _no_threads() -> None:
    """Refuse to fork beside threads, which a fork would lack."""
    if _threads() > 1:
        raise pytest.UsageError(
            f"{''.join(STARTED) or 'something'} starts threads as it is collected: make what its "
            "module computes, or gives to parametrize, in a function with functools.cache"
        )


def _received(line: Connection) -> Any:
    """What a worker tells; None once it has ended.

    A worker is forked outside of the ``except``: failures in it would be told as its consequence.
    """
    try:
        return line.recv()
    except (EOFError, ConnectionResetError):
        return None


@dataclass
class _Worker:
    """A fork, as its parent knows it."""

    pid: int
    line: Connection
    browser: bool
    current: str = ""
    folder: str = ""
    left: dict[str, int] = field(default_factory=dict)
    """Tests that it was given and hasn't ended, with the number of their group."""


class _Loop:
    """The parent: hands out files and takes in reports."""

    def __init__(self, session: pytest.Session, forks: int, browsers: int) -> None:
        self.session, self.config = session, session.config
        self.groups = _by_file(session.items)
        self.items = {item.nodeid: item for item in session.items}
        self.plain = deque(k for k, group in enumerate(self.groups) if not _in_browser(group[0]))
        self.pages = deque(k for k, group in enumerate(self.groups) if _in_browser(group[0]))
        self.forks, self.browsers = min(forks, len(self.groups)), browsers
        self.base = session.config._tmp_path_factory.getbasetemp()  # type: ignore[attr-defined]
        self.workers: list[_Worker] = []
        self.begun = 0
        self.held: dict[str, list[Any]] = {}
        self.again: list[Group] = []
        self.retried: set[str] = set()

    def run(self) -> None:
        _no_threads()
        gc.collect()
        gc.freeze()  # pages of memory that no collection writes to stay shared
        try:
            self._all()
            if self.again:
                self.pages.extend(range(len(self.groups), len(self.groups) + len(self.again)))
                self.groups += self.again
                self.retried = {item.nodeid for group in self.again for item in group}
                self.forks = self.browsers = 1
                self._all()
        finally:
            gc.unfreeze()  # else nanobind reports what is left at exit, line after line
            for worker in self.workers:
                os.kill(worker.pid, signal.SIGKILL)
                os.waitpid(worker.pid, 0)

    def _all(self) -> None:
        browsers = min(self.browsers, self.forks, len(self.pages))
        for number in range(self.forks):
            self._begin(browser=number < browsers)
        while self.workers:
            lines = {worker.line: worker for worker in self.workers}
            for line in wait(list(lines)):
                told = _received(line)  # type: ignore[arg-type]
                if told is None:
                    self._ended(lines[line])  # type: ignore[index]
                else:
                    self._take(lines[line], *told)  # type: ignore[index]
            if self.session.shouldfail:
                raise self.session.Failed(self.session.shouldfail)
            if self.session.shouldstop:
                raise self.session.Interrupted(self.session.shouldstop)

    def _begin(self, browser: bool) -> None:
        ours, theirs = Pipe()
        number, self.begun = self.begun, self.begun + 1
        pid = os.fork()
        if pid == 0:
            ours.close()
            _work(self.session, theirs, self.groups, number, self.base)
        theirs.close()
        self.workers.append(_Worker(pid, ours, browser))

    def _take(self, worker: _Worker, kind: str, said: Any) -> None:
        if kind == "next":
            number = self._next(worker)
            worker.left |= {} if number is None else {i.nodeid: number for i in self.groups[number]}
            worker.line.send(number)
        elif kind == "begin":
            worker.current = said
        elif kind == "report":
            found = self.config.hook.pytest_report_from_serializable(config=self.config, data=said)
            self.held.setdefault(found.nodeid, []).append(found)
        else:
            del worker.left[said]
            worker.current = ""
            self._report(said)

    def _next(self, worker: _Worker) -> int | None:
        """Choose a file: of the worker's own folder, else of a folder where no other is at work.

        Files of a folder load the same kernels and libraries, and compile those that are missing.
        """
        queue = self.pages if worker.browser else self.plain
        if not queue:
            return None
        others = {one.folder for one in self.workers if one is not worker}
        own = [k for k in queue if self._folder(k) == worker.folder]
        free = [k for k in queue if self._folder(k) not in others]
        number = (own or free or queue)[0]
        queue.remove(number)
        worker.folder = self._folder(number)
        return number

    def _folder(self, number: int) -> str:
        return str(self.groups[number][0].path.parent)

    def _report(self, name: str) -> None:
        """Tell pytest of a test that has ended, unless it is to be tried again."""
        found, item = self.held.pop(name), self.items[name]
        failed = any(report.failed for report in found)
        if _in_browser(item) and not self.retried and failed and self.forks > 1:
            file = [one for one in self.session.items if one.path == item.path and _in_browser(one)]
            self.again += [] if file in self.again else [file]
            self.held[f"{name} again"] = found
            return
        if self.retried and self.held.pop(f"{name} again", None) is None:
            return  # it passed the first time, beside the one that is tried again
        for report in found:
            self.config.hook.pytest_runtest_logreport(report=report)
        self.config.hook.pytest_runtest_logfinish(nodeid=name, location=item.location)

    def _ended(self, worker: _Worker) -> None:
        """Fail the test at which a worker died, and let another go on with what was its."""
        self.workers.remove(worker)
        _, status = os.waitpid(worker.pid, 0)
        if not worker.left:
            if worker.browser and self.plain:  # Playwright's event loop is no place for others
                self._begin(browser=False)
            return
        name = worker.current or next(iter(worker.left))
        why = f"worker died at {name} (wait status {status})"
        item, told = self.items[name], {"keywords": {}, "when": "call", "outcome": "failed"}
        self.held[name] = [pytest.TestReport(name, item.location, longrepr=why, **told)]  # type: ignore[arg-type]
        del worker.left[name]
        self._report(name)
        rest = [self.items[one] for one in worker.left]
        (self.pages if worker.browser else self.plain).extend(
            range(len(self.groups), len(self.groups) + len(_by_file(rest)))
        )
        self.groups += _by_file(rest)
        self._begin(worker.browser)


class _Teller:
    """Send what pytest reports to the parent."""

    def __init__(self, config: pytest.Config, line: Connection) -> None:
        self.config, self.line = config, line

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        data = self.config.hook.pytest_report_to_serializable(config=self.config, report=report)
        self.line.send(("report", data))


def _work(
    session: pytest.Session, line: Connection, groups: list[Group], number: int, base: Any
) -> None:
    """Run what the parent hands out; never returns."""
    code = 1
    try:
        _apart(session.config, number, base)
        session.config.pluginmanager.register(_Teller(session.config, line))
        for item, after in _pairs(line, groups):
            line.send(("begin", item.nodeid))
            session.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
            line.send(("end", item.nodeid))
        code = 0
    finally:
        line.close()
        os._exit(code)


def _pairs(line: Connection, groups: list[Group]) -> Iterator[tuple[pytest.Item, Any]]:
    """Each test with the next; what a session shares stays until there is none."""

    def more() -> Group:
        line.send(("next", None))
        number = line.recv()
        return [] if number is None else list(groups[number])

    group = more()
    while group:
        yield from pairwise(group)
        following = more()
        yield group[-1], following[0] if following else None
        group = following


def _apart(config: pytest.Config, number: int, base: Any) -> None:
    """Part with what a fork must not share: terminal, files of captured output, folders."""
    config.pluginmanager.unregister(name="terminalreporter")
    capture = config.pluginmanager.getplugin("capturemanager")
    capture.stop_global_capturing()
    capture.start_global_capturing()
    folder = base / f"worker-{number}"
    folder.mkdir(mode=0o700)
    config._tmp_path_factory._basetemp = folder  # type: ignore[attr-defined]
    # As pytest-xdist names its workers: what several of them use is made once (`made_once`).
    os.environ["PYTEST_XDIST_WORKER"] = f"gw{number}"
    os.environ["PRINTCTL_DATA"] = str(folder / "data")
