"""Wait conditions of a simulated board's command: time, temperature, planner space, motion end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from sim.devices.board.machine import Machine


class Wait(Protocol):
    """Something that a command waits for."""

    @property
    def for_user(self) -> bool:
        """Whether somebody has to do something."""

    def done(self, machine: Machine) -> bool:
        """Whether it has come."""

    def at(self, machine: Machine) -> float:
        """When to look next, s; infinity where only the host can end it."""


Task = Iterator[Wait]
Steps = Task | None
"""What a command still has to wait for; None where it is done at once."""


@dataclass(frozen=True)
class WaitUntil:
    """A moment on the printer's clock."""

    time: float
    for_user: bool = False

    def done(self, machine: Machine) -> bool:
        """Whether it has passed."""
        return machine.now >= self.time

    def at(self, machine: Machine) -> float:
        """The moment."""
        return self.time


@dataclass(frozen=True)
class WaitFreeSlot:
    """A free place in the planner's ring."""

    for_user: bool = False

    def done(self, machine: Machine) -> bool:
        """Whether there is one."""
        return machine.motion.blocks < len(machine.motion.ring) - 1

    def at(self, machine: Machine) -> float:
        """When a block ends."""
        return machine.motion.next_event()


@dataclass(frozen=True)
class WaitStandstill:
    """All motors stand and the planner takes moves."""

    for_user: bool = False

    def done(self, machine: Machine) -> bool:
        """Whether they do."""
        return machine.motion.blocks == 0 and machine.now >= machine.motion.closed_until

    def at(self, machine: Machine) -> float:
        """When a block ends, or the pause after a quickstop."""
        motion = machine.motion
        return motion.next_event() if motion.blocks else motion.closed_until


@dataclass(frozen=True)
class User:
    """Somebody's click, or a moment by which none came."""

    until: float
    for_user: bool = True

    def done(self, machine: Machine) -> bool:
        """Whether the user has answered."""
        return not machine.waits_for_user or machine.now >= self.until

    def at(self, machine: Machine) -> float:
        """When it gives up."""
        return self.until
