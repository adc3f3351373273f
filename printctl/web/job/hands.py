"""What may be done to a print that goes on; asking twice does no harm."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, Literal

from printctl.cli.resume import changed_head, new_syringe
from printctl.link.care import Care
from printctl.link.client import PrintClient, attach
from printctl.link.marks import MarkKind
from printctl.link.states import LinkState, Status
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.errors import ConflictError

After = Literal["now", "layer", "vessel"]
_HELD: Final = (LinkState.PAUSED, LinkState.PAUSING)
_GOING: Final = (LinkState.PRINTING, LinkState.RESUMING)


class PrintHands:
    """Pause, resume, change of syringe, confirm alive, cancel.

    Parameters
    ----------
    core : Core
    """

    def __init__(self, core: Core) -> None:
        self._core = core

    def pause(self, who: Principal, job: str, after: After = "now") -> Status:
        """Hold the print now, or once this layer or vessel has ended."""
        self._core.controls.require(who)
        with self._print(job) as client:
            if client.status.state not in _HELD:
                client.pause(None if after == "now" else MarkKind(after))
            return client.status

    def resume(
        self,
        who: Principal,
        job: str,
        *,
        plunger_mm: float | None = None,
        syringe: str | None = None,
        unchanged: bool = False,
    ) -> Status:
        """Go on; after a change of syringe with what was put in.

        Parameters
        ----------
        plunger_mm : float, mm
            Travel that the new syringe's plunger has used up; 0 for a full one.
        syringe : str
            Its profile, where it is another.
        unchanged : bool
            The syringe wasn't changed after all.

        Raises
        ------
        ConflictError
            When what was told contradicts itself.
        Refused
        """
        self._core.controls.require(who)
        told = plunger_mm is not None or bool(syringe)
        if unchanged and told:
            raise ConflictError("the syringe is either unchanged or a new one; say one of both")
        with self._print(job) as client:
            status = client.status
            if status.state in _GOING and not status.waits_for:
                return status
            change = None
            if told:
                care, head = Care.from_dict(client.record.care), changed_head(status)
                profile = client.record.profile
                change = new_syringe(care, profile, syringe or None, plunger_mm or 0.0, head)
            client.resume(change, unchanged)
            return client.status

    def reload(self, who: Principal, job: str, head: int | None = None) -> Status:
        """Make room to change the syringe: at the next reload point, or here when it is paused."""
        self._core.controls.require(who)
        with self._print(job) as client:
            if not client.status.waits_for.startswith("syringe"):
                client.reload(head)
            return client.status

    def alive(self, who: Principal, job: str) -> Status:
        """Confirm that somebody is there."""
        self._core.controls.require(who)
        with self._print(job) as client:
            client.alive()
            return client.status

    def cancel(self, job: str) -> Status:
        """End the print by a controlled stop; needs no controls."""
        with self._print(job) as client:
            if client.status.state is not LinkState.STOPPING:
                client.stop()
            return client.status

    @contextmanager
    def _print(self, job: str) -> Iterator[PrintClient]:
        with attach(self._core.workspace.print_folder(job)) as client:
            status = client.status
            if status.ended:
                raise ConflictError(
                    f"the print of {job} is over ({status.state.value}: {status.message})"
                )
            yield client
