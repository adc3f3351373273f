"""Finding prints of a job: running, printed or interrupted."""

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from printctl.errors import PrintctlError, SafetyError
from printctl.machine.link.retreat import Retreat
from printctl.machine.link.states import LinkState
from printctl.machine.printing import Order, find_or_start, running
from tests.sim_process import printer_process

MOVES = 3000


@pytest.fixture
def port(tmp_path: Path) -> Iterator[str]:
    """A simulated printer that a host takes for a real one; slow enough to be caught printing."""
    with printer_process(tmp_path, speed=5) as name:
        yield name


def _order(folder: Path, port: str, moves: int = MOVES) -> Order:
    job = folder / "job.gcode"
    lines = ["G21", "G90", "M82", "G92 X0 Y0 Z0 E0"]
    lines += [f"G1 X{5 * (k % 2)} F3000" for k in range(1, moves + 1)]
    job.write_text("\n".join([*lines, "M400"]) + "\n")
    return Order(job, "generic_marlin", port, folder / "print", Retreat())


def test_print_that_goes_on_is_found_again(tmp_path: Path, port: str) -> None:
    order = _order(tmp_path, port)
    first = find_or_start(order, lambda: port)
    pid = first.record.pid
    first.detach()
    again = find_or_start(order, lambda: pytest.fail("a second print was started"))
    assert again.record.pid == pid
    again.kill()
    assert again.wait(30).state is LinkState.KILLED


def test_another_file_is_refused_while_one_prints(tmp_path: Path, port: str) -> None:
    order = _order(tmp_path, port)
    client = find_or_start(order, lambda: port)
    order.job.write_text(order.job.read_text() + "G1 X1\n")
    try:
        with pytest.raises(PrintctlError, match="another file"):
            running(order)
    finally:
        client.kill()
        client.wait(30)


def test_interrupted_print_is_neither_repeated_nor_resumed_unasked(
    tmp_path: Path, port: str
) -> None:
    order = _order(tmp_path, port)
    client = find_or_start(order, lambda: port)
    for status in client.events():
        if status.lines_done > 20:
            break
    os.kill(client.record.pid, signal.SIGKILL)
    client.wait(30)
    with pytest.raises(SafetyError, match="--resume"):
        find_or_start(order, lambda: port)
    text = order.job.read_text()
    order.job.write_text(text + "G1 X1\n")  # as of a recipe that was changed meanwhile
    with pytest.raises(SafetyError, match=r"another file was interrupted.*give-up"):
        find_or_start(replace(order), lambda: port)
    order.job.write_text(text)
    resumed = find_or_start(replace(order, resume=True), lambda: port)
    resumed.kill()
    resumed.wait(30)


def test_what_is_printed_counts_once_for_a_run(tmp_path: Path, port: str) -> None:
    order = replace(_order(tmp_path, port, moves=5), once=True)
    assert find_or_start(order, lambda: port).wait(60).state is LinkState.DONE
    again = find_or_start(order, lambda: pytest.fail("printed twice"))
    assert again.wait(5).state is LinkState.DONE
