"""Command-line option `--datums`: datum features of the part's reference frame."""

from __future__ import annotations

from design.network import VesselNetwork
from printctl.errors import UsageError
from registration.errors import DatumError
from registration.measuring.geometry import Datum, check_designed, read_datums


def datums_of(text: str | None, network: VesselNetwork) -> tuple[Datum, ...]:
    """Read ``--datums`` and hold it against the design; none for the best fit.

    Raises
    ------
    UsageError
        For an empty list, a datum that isn't known, and one that the design doesn't have.
    """
    if text is None:
        return ()
    if not text.replace(",", "").strip():
        raise UsageError(
            "--datums is empty; name datum features like 'face -z, face -x, axis 3', or leave the "
            "option out for the best fit"
        )
    try:
        datums = read_datums(text.split(","))
        check_designed(datums, network)
    except DatumError as exc:
        raise UsageError(f"--datums: {exc}") from exc
    return datums
