"""Ring buffer of the last ten minutes' readings."""

from printctl.machine.station import StationState, StationStatus, Temperature
from printctl.web.printer.plots import KEPT_S, Plots


def status(now: float, target: float | None = 0.0) -> StationStatus:
    return StationStatus(
        StationState.READY,
        temperatures=(Temperature("bed", now, target),),
        readings=("M871: 12.5 N, at most 40 N", "M872: not read yet, at most 3 kPa"),
    )


def test_ten_minutes_are_kept_once_a_second() -> None:
    now = [0.0]
    plots = Plots(lambda: now[0])
    for tick in range(2 * 1500):
        now[0] = tick / 2
        plots.add(status(20.0))
    samples = plots.samples()
    assert samples[-1].at_s - samples[0].at_s <= KEPT_S
    assert len(samples) == KEPT_S + 1
