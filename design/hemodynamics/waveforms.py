"""Periodic waveforms of flow or pressure: constant, sine, samples; from names or CSV files.

Goes in: a name, or a CSV file. Comes out: a periodic waveform.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowInputError
from kernels.arrays import FloatArray

Interpolation = Literal["linear", "spline"]


class WaveTolerances(NamedTuple):
    """Tolerances of samples and of harmonics."""

    period: float = 1e-6
    """Relative difference of times that count as one period."""
    rounding: float = 1e-9
    """Of the largest value, below which a wave counts as at 0."""
    oversampling: int = 16
    """Samples of the waveforms for each step: kinks don't alias into the mean."""
    silent: float = 1e-13
    """Harmonics weaker than this part of the strongest aren't solved for."""


TOLERANCES: Final = WaveTolerances()


class Waveform(Protocol):
    """A value for every time, in whatever unit it stands for."""

    @property
    def period_s(self) -> float | None:
        """After which it repeats, s; None where it never changes."""
        ...

    def at(self, time_s: FloatArray) -> FloatArray:
        """Values at any times, same shape."""
        ...


@dataclass(frozen=True)
class Constant:
    """Constant waveform."""

    value: float

    def __post_init__(self) -> None:
        _finite("value", self.value)

    @property
    def period_s(self) -> None:
        """None: it goes with any period."""
        return None

    def at(self, time_s: FloatArray) -> FloatArray:
        """The value, in the shape of ``time_s``."""
        return np.full(np.shape(time_s), float(self.value))


@dataclass(frozen=True)
class Sine:
    """mean + amplitude sin(2π t/period + phase)."""

    mean: float
    amplitude: float
    period_s: float
    phase_rad: float = 0.0

    def __post_init__(self) -> None:
        check_period(self.period_s)
        for name in ("mean", "amplitude", "phase_rad"):
            _finite(name, getattr(self, name))

    def at(self, time_s: FloatArray) -> FloatArray:
        """Values at any times, same shape."""
        angle = 2.0 * np.pi * np.asarray(time_s) / self.period_s + self.phase_rad
        return self.mean + self.amplitude * np.sin(angle)


class Tabulated:
    """Samples over one period, joined by straight lines or by a periodic cubic spline.

    Parameters
    ----------
    time_s : (n,) float64, s
        Rising, from its first to less than a period later. A last sample a whole period after
        the first closes the cycle and has to equal it.
    value : (n,) float64
    period_s : float, s, optional
        Without it the last sample closes the cycle.
    interpolation : {"linear", "spline"}

    Raises
    ------
    FlowInputError
        Fewer than two samples, a missing (NaN) sample, times that don't rise, a period that
        isn't above 0 or is shorter than the samples, a cycle that doesn't close.
    """

    def __init__(
        self,
        time_s: FloatArray,
        value: FloatArray,
        period_s: float | None = None,
        interpolation: Interpolation = "linear",
    ) -> None:
        time, values = np.asarray(time_s, dtype=np.float64), np.asarray(value, dtype=np.float64)
        _check_samples(time, values)
        span = float(time[-1] - time[0])
        closed = period_s is None or abs(period_s - span) < TOLERANCES.period * period_s
        self._period = check_period(span if period_s is None else period_s)
        if span > self._period * (1.0 + TOLERANCES.period):
            raise FlowInputError(
                f"the waveform's samples span {span:g} s, more than its period "
                f"{self._period:g} s; give one cycle, or the right period"
            )
        if closed:
            _check_closed(values)
        else:
            time = np.append(time, time[0] + self._period)
            values = np.append(values, values[0])
        values[-1] = values[0]
        self._start, self._time, self._value = time[0], time, values
        self._spline = _periodic_spline(time, values) if interpolation == "spline" else None

    @property
    def period_s(self) -> float:
        """After which it repeats, s."""
        return self._period

    @property
    def samples(self) -> FloatArray:
        """The values given, (n,), closed to a cycle."""
        return self._value

    def at(self, time_s: FloatArray) -> FloatArray:
        """Values at any times, same shape."""
        within = self._start + np.mod(np.asarray(time_s) - self._start, self._period)
        if self._spline is not None:
            return np.asarray(self._spline(within))
        return np.asarray(np.interp(within, self._time, self._value))


def harmonics_of(
    waveforms: Sequence[Waveform], period_s: float, steps: int
) -> tuple[NDArray[np.int64], NDArray[np.complex128]]:
    """Numbers (k,) and amplitudes (w, k) of the harmonics of a cycle of so many steps.

    Kept are those below half as many, of 0 always. Where, cut off, a wave that is never below 0
    swings below it, four times as many are kept and damped by Jackson's kernel, which is
    positive, so that what it smooths stays so (Weisse et al. 2006, Rev Mod Phys 78, 275,
    doi 10.1103/RevModPhys.78.275, equation 71).
    """
    times = cycle_times(period_s, steps * TOLERANCES.oversampling)
    samples = np.array([wave.at(times) for wave in waveforms])
    size, fine, n = len(times), 2 * steps, np.arange(len(times) // 2 + 1)
    spectrum = np.fft.rfft(samples, axis=1)
    kept = np.where(n < (steps + 1) // 2, spectrum, 0.0)
    swing = np.fft.irfft(kept, size, axis=1).min(axis=1)
    rings = (samples.min(axis=1) >= 0.0) & (swing < -TOLERANCES.rounding * samples.max(axis=1))
    angle = np.pi / (fine + 1)
    damping = (fine - n + 1) * np.cos(angle * n) + np.sin(angle * n) / np.tan(angle)
    damped = (spectrum * np.where(n < fine, damping / (fine + 1), 0.0))[rings]
    # Sampled at the steps, harmonic ``steps`` would show in the mean: left out, and what it may
    # have held above 0 is taken from the swing.
    alone = 2.0 * np.abs(damped[:, steps]) / size
    mean = damped[:, 0].real / size
    damped[:, 1:] *= np.where(n[1:] == steps, 0.0, (mean / (mean + alone))[:, None])
    kept[rings] = damped
    amplitudes = np.where(n == 0, 1.0, 2.0) / size * kept
    # Pressures and flows are in units of their own: each waveform by its own scale.
    scale = np.maximum(np.abs(amplitudes).max(axis=1, keepdims=True), 1e-300)
    heard = (np.abs(amplitudes) / scale).max(axis=0) > TOLERANCES.silent
    heard[0] = True
    return np.flatnonzero(heard), np.asarray(amplitudes[:, heard], dtype=np.complex128)


def check_period(period_s: float) -> float:
    """Return the period; raise `FlowInputError` unless it is above 0."""
    if not (np.isfinite(period_s) and period_s > 0.0):
        raise FlowInputError(f"the waveform's period is {period_s:g} s; give one above 0")
    return float(period_s)


def cycle_times(period_s: float, steps: int, *, closed: bool = False) -> FloatArray:
    """Times of the steps of a cycle from 0, its end left out or, ``closed``, with it, s."""
    return np.asarray(np.arange(steps + int(closed)) * (period_s / steps), dtype=np.float64)


def common_period(waveforms: tuple[Waveform, ...]) -> float | None:
    """Return the period that all share, s, None where all are constant; raise if they differ."""
    periods = [w.period_s for w in waveforms if w.period_s is not None]
    for period in periods[1:]:
        if abs(period - periods[0]) > TOLERANCES.period * periods[0]:
            raise FlowInputError(
                f"waveforms have periods {periods[0]:g} and {period:g} s; give all the same one"
            )
    return periods[0] if periods else None


def _check_samples(time: FloatArray, value: FloatArray) -> None:
    if time.ndim != 1 or time.shape != value.shape:
        raise FlowInputError(
            f"the waveform has {time.size} times and {value.size} values; give a value each"
        )
    if len(time) < 2:
        raise FlowInputError(f"the waveform has {len(time)} samples; give at least two")
    missing = np.flatnonzero(~(np.isfinite(time) & np.isfinite(value)))
    if len(missing):
        raise FlowInputError(
            f"sample {int(missing[0]) + 1} of the waveform is missing ({len(missing)} of "
            f"{len(time)}); fill it in, or leave its time out"
        )
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if len(back):
        k = int(back[0])
        raise FlowInputError(
            f"the waveform's times don't rise: {time[k + 1]:g} s follows {time[k]:g} s (sample "
            f"{k + 2}); sort them and drop repeated ones"
        )


def _check_closed(value: FloatArray) -> None:
    gap, swing = abs(value[-1] - value[0]), float(np.ptp(value))
    if gap > 1e-3 * max(swing, TOLERANCES.period * float(np.abs(value).max())):
        raise FlowInputError(
            f"the waveform ends at {value[-1]:g} and began at {value[0]:g}, so its cycle doesn't "
            "close; repeat the first sample at the end, or give the period"
        )


def _finite(name: str, value: float) -> None:
    if not np.isfinite(value):
        raise FlowInputError(f"the waveform's {name} is {value}; give a number")


def _periodic_spline(time_s: FloatArray, value: FloatArray) -> Any:
    """Cubic spline through one period's samples (n,), whose ends are equal."""
    from scipy.interpolate import CubicSpline  # heavy: other waveforms do without

    return CubicSpline(time_s, value, bc_type="periodic")


_KASSAB_COS: Final = np.array([-0.005, -0.040, -0.034])
_KASSAB_SIN: Final = np.array([0.212, 0.086, 0.032])


def _ejection(phase: FloatArray) -> FloatArray:
    """Half a sine in systole, nothing in diastole: flow into the aorta in Windkessel models.

    I(t) = I₀ sin(π t/T_s) for t < T_s = 2/5 T (Catanho, Sinha & Vijayan 2012, Model of aortic
    blood flow using the Windkessel effect).
    """
    systole = 0.4
    return np.where(phase < systole, np.sin(np.pi * phase / systole), 0.0)


def _roller(phase: FloatArray) -> FloatArray:
    """A peristaltic pump, idealised: a rectified sine, one lobe a roller."""
    return np.abs(np.sin(np.pi * phase))


def _kassab(phase: FloatArray) -> FloatArray:
    """A coronary artery: three harmonics of the left anterior descending one's flow.

    Within 3 % of the mean of the wave in its main trunk (Huo & Kassab 2006, Am J Physiol Heart
    Circ Physiol 291, H1074, doi 10.1152/ajpheart.00200.2006; a cycle there lasts 0.7 s).
    Sexton et al. 2025 cite Kassab for the waves that drive their trees.
    """
    angle = 2.0 * np.pi * np.outer(np.arange(1, 4), phase)
    return 1.0 + _KASSAB_COS @ np.cos(angle) + _KASSAB_SIN @ np.sin(angle)


SHAPES: Final[dict[str, Callable[[FloatArray], FloatArray]]] = {
    "ejection": _ejection,
    "kassab": _kassab,
    "roller_pump": _roller,
}
"""Name to shape, a function of the phase in 0 to 1."""


def shape(name: str, mean: float, period_s: float) -> Tabulated:
    """Return the shape of that name in 200 samples, scaled to a mean.

    Raises
    ------
    FlowInputError
        For an unknown name, or an impossible period.
    """
    if name not in SHAPES:
        raise FlowInputError(f"there is no waveform {name!r}; choose one of {', '.join(SHAPES)}")
    phase = np.arange(200) / 200
    value = SHAPES[name](phase)
    return Tabulated(phase * check_period(period_s), mean * value / value.mean(), period_s)


def read_waveform(
    path: Path,
    column: str,
    scale: float = 1.0,
    period_s: float | None = None,
    interpolation: Interpolation = "linear",
) -> Tabulated:
    """Read the columns ``time_s`` and ``column``.

    Parameters
    ----------
    column : str
        Of the values; its name says their unit, such as ``flow_ml_min``.
    scale : float
        From that unit to ours.
    period_s, interpolation
        As of `Tabulated`.

    Raises
    ------
    FlowInputError
        A missing column, an empty or unreadable cell, samples that are no waveform.
    OSError
        When the file can't be read.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as handle:
            rows = list(csv.DictReader(handle))
    except (UnicodeDecodeError, csv.Error) as exc:
        raise FlowInputError(f"{path} isn't a CSV file: {exc}") from exc
    for name in ("time_s", column):
        if not rows or name not in rows[0]:
            raise FlowInputError(
                f"{path} has no column {name}; its first line names time_s,{column}"
            )
    time = [_cell(path, k, row["time_s"]) for k, row in enumerate(rows, 2)]
    value = [_cell(path, k, row[column]) for k, row in enumerate(rows, 2)]
    try:
        return Tabulated(np.array(time), scale * np.array(value), period_s, interpolation)
    except FlowInputError as exc:
        raise FlowInputError(f"{path}: {exc}") from exc


def _cell(path: Path, line: int, text: str | None) -> float:
    try:
        return float(text or "")
    except ValueError as exc:
        raise FlowInputError(
            f"{path}, line {line}: {text!r} is no number; fill the missing sample in, or leave "
            "the line out"
        ) from exc
