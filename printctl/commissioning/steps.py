"""Steps of a commissioning, in order, and the loop that does them where it stopped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from firmware_profiles import Printer, load
from firmware_profiles.yaml_file import read_yaml
from printctl.commissioning.bench import Bench
from printctl.commissioning.state import (
    Answering,
    CheckFailedError,
    Commission,
    Desk,
    StepRecord,
    UnansweredError,
    now,
)
from printctl.errors import UsageError
from printctl.machine.ports.detection import named_port


@dataclass(frozen=True)
class Step:
    """One step.

    Attributes
    ----------
    key, title : str
    needs : str
        What must be ready before.
    how : str
        What is done.
    check : str
        What decides that it is done.
    do : str
        Module and function that does it and returns the message of its check, or raises
        `CheckFailedError`; loaded when it is done, for it takes design and registration.
    """

    key: str
    title: str
    needs: str
    how: str
    check: str
    do: str


STEPS: Final = tuple(
    Step(**one) for one in read_yaml(Path(__file__).with_name("steps.yaml").read_text("utf-8"))
)
KEYS: Final = tuple(step.key for step in STEPS)


def step_named(key: str) -> Step:
    """Return a step; UsageError where there is none."""
    for step in STEPS:
        if step.key == key:
            return step
    raise UsageError(f"there is no step {key!r}; the steps are {', '.join(KEYS)}")


def next_step(commission: Commission) -> Step | None:
    """Return the first step that isn't done; None where all are."""
    return next((one for one in STEPS if commission.step(one.key).state != "done"), None)


def reopen(commission: Commission, key: str) -> None:
    """Forget a step and those after it, which rest on it."""
    for step in STEPS[KEYS.index(step_named(key).key) :]:
        commission.steps[step.key] = StepRecord()
    commission.save()


def change_port(commission: Commission, port: str) -> None:
    """Go on at another port: a cable in another socket. Its firmware is compared again."""
    answers = commission.step("profile").answers
    if answers.get("port", port) == port or commission.step("profile").state != "done":
        return
    answers["port"] = named_port(port, load(Printer, commission.printer))
    commission.steps["connection"] = StepRecord()
    commission.save()


def overview(commission: Commission) -> dict[str, Any]:
    """Return the steps with their results, JSON-able."""
    rows = []
    for step in STEPS:
        record = commission.step(step.key)
        about = {key: getattr(step, key) for key in ("key", "title", "needs", "how", "check")}
        result = {key: getattr(record, key) for key in ("state", "message", "when", "facts")}
        rows.append(about | result)
    following = next_step(commission)
    return {
        "printer": commission.printer,
        "file": str(commission.file),
        "folder": str(commission.folder),
        "port": commission.step("profile").answers.get("port", ""),
        "next": None if following is None else following.key,
        "done": following is None,
        "steps": rows,
    }


def do_next(
    commission: Commission,
    answering: Answering,
    say: Callable[[str], None],
    station: Path,
    sim_speed: float = 0.0,
) -> Step:
    """Do the first step that isn't done, to its check; return it.

    Parameters
    ----------
    commission : Commission
    answering : callable
        Gives the answers; see `Answering`.
    say : callable
        Told what goes on.
    station : Path
        Folder of the printer's station.
    sim_speed : float
        Of a simulated printer, times real time; 0 for as fast as it can.

    Raises
    ------
    UnansweredError
        The step waits for an answer; what it has done is kept.
    CheckFailedError
        Its check failed, and it stays open.
    PrintctlError, LinkError, ProfileError, OSError
        Whatever stopped it.
    """
    step = next_step(commission)
    if step is None:
        raise UsageError("every step is done; --from STEP begins again at one of them")
    record = commission.step(step.key)
    desk = Desk(commission, step.key, answering, say)
    port = commission.step("profile").answers.get("port", "")
    try:
        module, name = step.do.split(":")
        do = getattr(import_module(f"printctl.commissioning.{module}"), name)
        message = do(desk, Bench(commission.printer, port, station, sim_speed))
    except UnansweredError:
        raise
    except CheckFailedError as failed:
        for key in failed.forget:
            record.answers.pop(key, None)
            record.facts.pop(key, None)
        record.state, record.message, record.when = "failed", str(failed), now()
        commission.save()
        raise
    record.state, record.message, record.when = "done", message, now()
    commission.save()
    return step
