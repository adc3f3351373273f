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


def test_targets_and_readings_are_columns_and_an_off_heater_has_no_line() -> None:
    now = [0.0]
    plots = Plots(lambda: now[0])
    plots.add(status(20.0, 0.0))
    now[0] = 1.0
    plots.add(status(21.0, 37.0))
    assert plots.columns() == {
        "at_s": [0.0, 1.0],
        "now_c": {"bed": [20.0, 21.0]},
        "target_c": {"bed": [None, 37.0]},
        "readings": {"M871 (N)": [12.5, 12.5]},
        "limits": {"M871 (N)": [40.0, 40.0]},
    }


def test_a_printer_that_is_gone_adds_nothing() -> None:
    plots = Plots(lambda: 0.0)
    plots.add(StationStatus(StationState.LOST, temperatures=(Temperature("bed", 20.0),)))
    assert plots.samples() == []
