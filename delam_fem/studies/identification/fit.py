"""Fit keys of a case to measured frequency responses of a structure that nothing touches.

The unknowns θ are the keys that are sought, those in which the rig may differ from its case, and a
gain of each channel. With H of the case (`of_channels`) and the measured responses H_m, the maximum
of the posterior is the minimum of

    Σ |g H(θ) - H_m|²/(2 σ²) + Σ (θ - θ_0)²/(2 τ²)                                              (F2)

with the standard deviation σ of real and imaginary part of a response, and τ of the prior. Peaks
are narrow, so that (F2) has many minima. The logarithm of H has fewer: cases from the prior are
compared with the measurement by it, and the nearest ones are led on, at first in the logarithm.

σ is what the fit leaves near a line, and at least what the measurement says. What is left of
neighbouring lines is alike where the structure differs from its model. The covariance of θ follows
from the curvature of (F2), and from the scatter of the slopes of (F2) over blocks of lines,
whichever gives the larger error (the second is White's sandwich in blocks).

Source: H. White, Econometrica 50 (1982) 1; D. Ewins, Modal Testing, 2nd ed., 2000, ch. 5.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares, nnls

from delam_fem.api import (
    Case,
    CaseError,
    Finding,
    FloatArray,
    Report,
    Sensor,
    assemble,
    beams,
    of_channels,
    schema,
    statistics,
    style,
)
from delam_fem.studies.identification.posterior import described
from delam_fem.studies.identification.unknowns import Unknown, require_values, value_of
from delam_fem.studies.signals import reading
from delam_fem.studies.signals.units import ratio_of

Progress = Callable[[int, int], None]
"""Function that is told the numbers of finished and of all trials."""
POWERS = {"displacement": 0, "velocity": 1, "acceleration": 2}
"""Factors s of a quantity over the displacement."""
OF_DRIVE = {"m": 0, "m/s": 1, "m/s2": 2, "N": 0}
"""The same of a drive by its unit."""
OF_PLACE = "fitted-"
"""Start of the names of sensors at measured places."""
GAIN = 0.02
"""Standard deviation of the gain of a sensor [-]."""
UNIFORM = 1.0 / np.sqrt(12.0)
"""Standard deviation of a uniform distribution of width 1."""
DECADE = 10.0
"""Ratio of the ends of a prior from which on it is one over decades."""
TRIALS, LED_ON = 60, 3
"""Cases from the prior that are compared with the measurement, and most that are led on."""
EXPLAINED = 0.05
"""Median difference of logarithms at which no further case is led on."""
SLOPE = 3e-4
"""Step of the differences that give slopes, in widths of the prior."""
NEAR = 21
"""Lines over which σ is averaged."""
FEW, LONGEST = 8, 20
"""Steps by which the nearest cases are led on, and most steps of a fit."""
NEARLY, SETTLED = 1e-3, 1e-5
"""Share by which the last step of a fit lowers the sum, of logarithms and of (F2)."""
FAR = 0.1
"""Difference of logarithms beyond which a line counts less."""
THIN = 100
"""Most lines of a file by which cases are sought."""
PASSES = 6
"""Passes in which the noise of a row is found."""
ROUNDS = 3
"""Fits with σ of the fit before."""
LEAST_SHARE = 1e-4
"""Least σ over the size of a response: a model knows it no better."""
BLOCKS, LEAST_LINES = 20, 8
"""Most blocks of lines whose slopes are compared, and least lines of one."""
DRAWS = 4000
"""Draws from the posterior."""
DRIVEN = 1e-3
"""Least density of the excitation over its largest one at lines that count."""
UNEXPLAINED = 3.0
"""What is left of a response over its noise from which on the rig is not its model."""


@dataclass(frozen=True)
class MeasuredResponses:
    """Frequency responses of a file.

    Attributes:
        path: the file.
        names: of the channels, shape (n,).
        units: of their responses, shape (n,).
        frequency: lines, shape (k,) [Hz].
        s: where the responses are known, iω or iω + a, shape (k,) [1/s].
        values: responses, shape (n, k).
        deviation: standard deviations of real and imaginary part, shape (n, k); NaN: not known.
        channels: names of channels of the model, and powers of s on them, for each of the n.
        power: of s, on the drive.
    """

    path: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    frequency: FloatArray
    s: beams.ComplexArray
    values: beams.ComplexArray
    deviation: FloatArray
    channels: tuple[tuple[str, int], ...]
    power: int


@dataclass(frozen=True)
class Parameter:
    """An unknown of the fit, whose prior has the width 1 about 1/2.

    Attributes:
        keys: keys of the case that follow it; none: it is a gain.
        low: value at 0.
        high: value at 1.
        is_logarithmic: whether its logarithm is in proportion; else its value.
        factors: value of each key over the parameter.
        is_sought: whether it stays between low and high; others may lie as far beyond them.
        is_normal: whether it is normally distributed, with ends two deviations off.
    """

    keys: tuple[str, ...]
    low: float
    high: float
    is_logarithmic: bool
    factors: tuple[float, ...] = (1.0,)
    is_sought: bool = False
    is_normal: bool = False

    @property
    def deviation(self) -> float:
        """Standard deviation of the prior, in its widths.

        Over decades, as of clamps, a prior only says the order of magnitude, and a rig may lie
        beyond it: what is rigid has no stiffness.
        """
        if self.is_normal:
            return 0.25
        is_of_decades = self.is_logarithmic and self.high >= DECADE * self.low
        return 1.0 if is_of_decades and not self.is_sought else UNIFORM

    def value(self, place: float) -> float:
        """Return the value at a place, 0 at low and 1 at high."""
        if self.is_logarithmic:
            return float(self.low * (self.high / self.low) ** place)
        return self.low + (self.high - self.low) * place


def has_responses(path: Path) -> bool:
    """Return whether a file holds frequency responses, as `measure response` writes them."""
    if path.suffix != ".nc":
        return False
    try:
        with xr.open_dataset(path) as data:
            return "response_real" in data or "response" in data
    except (OSError, ValueError):
        return False  # its reader says what is wrong


def read(
    path: Path, case: Case, names: Sequence[str], band: Sequence[float] | None
) -> tuple[MeasuredResponses, Case]:
    """Read the responses of a file, and return them with the case that has all their channels.

    Args:
        path: what `measure response` has written.
        case: the case.
        names: channels that are wanted; none: all that the case has.
        band: lowest and highest frequency [Hz]; None: all that are driven.

    Raises:
        CaseError: the file does not fit the case, or its record claps.
    """
    data = reading.read_measured(path)
    if not int(data.attrs.get("is_linear", 1)):
        raise CaseError(
            f"{path}: expected responses of a structure in which nothing touches, given some that "
            "are not linear; measure at a lower level, or identify keys from motions with "
            "--frequency"
        )
    about = data["response"].attrs
    unit = str(about.get("excitation_units", ""))
    acts_on = "force" if unit == "N" else "base"
    if unit not in OF_DRIVE:
        raise CaseError(
            f"{path}: expected responses to a force or to a motion of the base, given "
            f"{about.get('excitation', 'no word of the excitation')} {f'[{unit}]' if unit else ''}"
        )
    if acts_on != case.excitation.acts_on:
        raise CaseError(
            f"{path}: expected responses to the {case.excitation.acts_on}, which "
            f"excitation.kind = {case.excitation.kind!r} of the case drives, given responses to "
            f"the {acts_on}"
        )
    frequency: FloatArray = data["frequency"].to_numpy()
    variable = "damped_response" if "damped_response" in data else "response"
    decay = float(data[variable].attrs.get("decay", 0.0))
    values = np.asarray(data[variable].to_numpy().T, dtype=np.complex128)
    counts = (frequency > 0.0) & np.isfinite(values).all(axis=0) & (values != 0.0).any(axis=0)
    if band is not None:
        counts &= (frequency >= band[0]) & (frequency <= band[1])
    elif "psd_excitation" in data:
        density = data["psd_excitation"].to_numpy()
        counts &= density > DRIVEN * density[frequency > 0.0].max()
    outputs = [str(name) for name in data["output"].to_numpy()]
    table = [str(name) for name in data["channel"].to_numpy()]
    rows = []
    units = []
    channels = []
    unknown = []
    for number, output in enumerate(outputs):
        key = output.removeprefix(schema.SENSOR)
        if names and not {output, key} & set(names):
            continue
        entry = {k: data[f"channel_{k}"][table.index(output)].item() for k in reading.TABLE}
        channel, case = _channel(case, key, entry)
        if channel is None:
            unknown.append(output)
        else:
            rows.append(number)
            unit_of_channel = str(data["channel_units"][table.index(output)].item())
            units.append(ratio_of(unit_of_channel, unit))
            channels.append(channel)
    missing = [n for n in names if n not in outputs and f"{schema.SENSOR}{n}" not in outputs]
    if missing or not rows:
        raise CaseError(
            f"{path}: expected responses of {', '.join(names) or 'channels of the case'}, given "
            f"{', '.join(outputs)}; a channel is a tip, a sensor of the case by its name and "
            "quantity, or has its place: 'NAME=COLUMN:UNIT@X/LAMINA' in measure read"
        )
    if counts.sum() < LEAST_LINES:
        raise CaseError(
            f"{path}: expected at least {LEAST_LINES} lines, given {int(counts.sum())}"
            f"{' in the band' if band else ''}"
        )
    deviation = np.full(values.shape, np.nan)
    for name in ("response_deviation", "response_noise"):
        if name in data and variable == "response":
            known = data[name].to_numpy().T / np.sqrt(2.0)  # of one part of two
            deviation = np.where(np.isfinite(deviation), deviation, known)
    values = values[rows][:, counts]
    deviation = deviation[rows][:, counts]
    for row, of_row in zip(values, deviation, strict=True):
        if np.isfinite(of_row).all():  # of few periods or realisations, it scatters itself
            of_row[:] = np.sqrt(_near(of_row**2, np.square(np.abs(row))))
    measured = MeasuredResponses(
        path, tuple(outputs[k] for k in rows), tuple(units), frequency[counts],
        2j * np.pi * frequency[counts] + decay, values, deviation, tuple(channels), OF_DRIVE[unit],
    )  # fmt: skip
    return measured, case


def _channel(
    case: Case, name: str, entry: dict[str, str | float]
) -> tuple[tuple[str, int] | None, Case]:
    """Return channel and power of s that a measured channel reads, and the case that has it.

    A channel with a place becomes a sensor of the case. None: the case has no such channel.
    """
    quantity = str(entry["quantity"])
    lamina = str(entry["lamina"])
    position = float(entry["position"])
    for sensor in case.sensor:
        if sensor.name == name:
            return ((name, 0) if sensor.quantity == quantity else None), case
    if lamina not in {of_case.name for of_case in case.lamina} or quantity not in POWERS:
        return None, case
    if not np.isfinite(position):
        if not name.startswith("tip"):
            return None, case
        layout = assemble(case, needs_dolfinx=case.model.is_continuum).layout
        probe = layout.probes[layout.names.index(lamina)]
        if probe.name == "tip":
            return (f"tip_{lamina}", POWERS[quantity]), case
        position = float(layout.parts[probe.part].x[probe.point])  # which no mesh moves
    name = f"{OF_PLACE}{len(case.sensor)}"
    place = Sensor(name=name, quantity="displacement", lamina=lamina, position=position)
    return (name, POWERS[quantity]), case.model_copy(update={"sensor": (*case.sensor, place)})


class ResponseModel:
    """Responses of a case with its unknowns, beside the measured ones.

    Attributes:
        case: the case with all channels.
        files: the measured responses.
        parameters: unknowns, gains last.
    """

    def __init__(
        self, case: Case, files: Sequence[MeasuredResponses], parameters: Sequence[Parameter]
    ) -> None:
        """Take a case, responses, and the unknowns without gains."""
        self.case = case
        self.files = files
        self.n_gains = sum(len(file.names) for file in files)
        low, high = np.exp([-2.0 * GAIN, 2.0 * GAIN]).tolist()
        gain = Parameter((), low, high, is_logarithmic=True, is_normal=True)
        self.parameters = (*parameters, *[gain] * self.n_gains)
        self.measured = [row for file in files for row in file.values]
        self._last_keys = b""
        self._last_rows: list[beams.ComplexArray] = []
        self._last_places = b""
        self._last_slopes: list[beams.ComplexArray] = []

    def thinned(self) -> ResponseModel:
        """Return the model with at most `THIN` lines of each file."""
        files = []
        for file in self.files:
            chosen = slice(None, None, -(-file.frequency.size // THIN))
            files.append(
                replace(
                    file, frequency=file.frequency[chosen], s=file.s[chosen],
                    values=file.values[:, chosen], deviation=file.deviation[:, chosen],
                )
            )  # fmt: skip
        return ResponseModel(
            self.case, files, self.parameters[: len(self.parameters) - self.n_gains]
        )

    def case_at(self, places: FloatArray, overrides: dict[str, object] | None = None) -> Case:
        """Return the case with the unknowns at places."""
        changes: dict[str, object] = dict(overrides or {})
        for parameter, place in zip(self.parameters, places.tolist(), strict=True):
            for key, factor in zip(parameter.keys, parameter.factors, strict=False):
                changes[key] = factor * parameter.value(place)
        return self.case.with_overrides(changes)

    def without_gains(self, places: FloatArray) -> list[beams.ComplexArray]:
        """Return the responses of the case, one row for each channel of each file.

        Those at the last places are kept: a fit asks for them again with their slopes.
        """
        keys = places[: places.size - self.n_gains].tobytes()
        if keys != self._last_keys:
            self._last_rows = self._computed(places)
            self._last_keys = keys
        return self._last_rows

    def _computed(
        self, places: FloatArray, overrides: dict[str, object] | None = None
    ) -> list[beams.ComplexArray]:
        """Return the responses of the case with the unknowns at places."""
        case = self.case_at(places, overrides)
        structure = assemble(case.without_impactors, needs_dolfinx=case.model.is_continuum)
        rows = []
        for file in self.files:
            channels = of_channels(structure, case, file.s)
            rows += [channels[name] * file.s ** (m - file.power) for name, m in file.channels]
        return rows

    def gains(self, places: FloatArray) -> list[float]:
        """Return the gains of all rows."""
        last = places[places.size - self.n_gains :].tolist()
        pairs = zip(self.parameters[-self.n_gains :], last, strict=True)
        return [parameter.value(place) for parameter, place in pairs]

    def responses(
        self, places: FloatArray, overrides: dict[str, object] | None = None
    ) -> list[beams.ComplexArray]:
        """Return the responses with gains, one row for each channel of each file."""
        rows = self._computed(places, overrides) if overrides else self.without_gains(places)
        return [gain * row for gain, row in zip(self.gains(places), rows, strict=True)]

    def slopes(self, places: FloatArray) -> list[beams.ComplexArray]:
        """Return dH/dθ of each row, shape (n_parameters, n_lines); the last ones are kept."""
        if places.tobytes() == self._last_places:
            return self._last_slopes
        at_first = self.without_gains(places)
        gains = self.gains(places)
        slopes = [np.zeros((places.size, row.size), np.complex128) for row in at_first]
        n_keys = places.size - self.n_gains
        for k in range(n_keys):
            step = SLOPE if places[k] < 0.5 else -SLOPE
            moved = places.copy()
            moved[k] += step
            for result, gain, row, before in zip(
                slopes, gains, self._computed(moved), at_first, strict=True
            ):
                result[k] = gain * (row - before) / step
        for k, (result, gain, row) in enumerate(zip(slopes, gains, at_first, strict=True)):
            parameter = self.parameters[n_keys + k]
            result[n_keys + k] = gain * np.log(parameter.high / parameter.low) * row
        self._last_places = places.tobytes()
        self._last_slopes = slopes
        return slopes

    @property
    def prior(self) -> FloatArray:
        """The derivative of `of_prior`, shape (n_parameters, n_parameters)."""
        return np.diag([1.0 / parameter.deviation for parameter in self.parameters])

    def of_prior(self, places: FloatArray) -> FloatArray:
        """Return what is left of the prior, in standard deviations."""
        deviations = np.array([parameter.deviation for parameter in self.parameters])
        return np.asarray((places - 0.5) / deviations)


def _parts(rows: Sequence[beams.ComplexArray]) -> FloatArray:
    """Return real and imaginary parts of rows, one after the other, along the last axis."""
    return np.concatenate([part for row in rows for part in (row.real, row.imag)], axis=-1)


def _logarithms(model: ResponseModel, places: FloatArray) -> FloatArray:
    """Return the logarithm of modelled over measured responses, and what is left of the prior."""
    rows = [
        np.log(row / np.where(measured == 0.0, row, measured))
        for row, measured in zip(model.responses(places), model.measured, strict=True)
    ]
    return np.concatenate([_parts(rows), model.of_prior(places)])


def _slopes_of_logarithms(model: ResponseModel, places: FloatArray) -> FloatArray:
    """Return the derivative of `_logarithms`, shape (n_values, n_parameters)."""
    rows = [
        slope / row
        for slope, row in zip(model.slopes(places), model.responses(places), strict=True)
    ]
    return np.vstack([_parts(rows).T, model.prior])


def _deviations(model: ResponseModel, rows: Sequence[beams.ComplexArray]) -> list[FloatArray]:
    """Return σ of each line of each row: what is left near it, and at least what is known."""
    known = [row for file in model.files for row in file.deviation]
    deviations = []
    for row, measured, stated in zip(rows, model.measured, known, strict=True):
        near = _near(0.5 * np.square(np.abs(row - measured)), np.square(np.abs(row)))
        least = np.maximum(np.nan_to_num(stated), LEAST_SHARE * np.abs(measured))
        deviations.append(np.sqrt(np.maximum(near, least**2)) + 1e-300)
    return deviations


def _near(square: FloatArray, size: FloatArray) -> FloatArray:
    """Return the mean square near each line of what scatters from line to line; see `_even`."""
    even = _even(square, size)
    return np.asarray(even * uniform_filter1d(square / even, min(NEAR, square.size)))


def _even(square: FloatArray, size: FloatArray) -> FloatArray:
    """Return the variance a² + b² |H|² that is nearest to what is left, shape (k,).

    Args:
        square: half the square of what is left, shape (k,).
        size: |H|², shape (k,).
    """
    terms = np.stack([np.full(size.size, size.mean()), size + 1e-300], axis=1)
    variance = terms[:, 1]
    for _ in range(PASSES):
        shares, _ = nnls(terms / variance[:, None], square / variance)
        variance = np.maximum(terms @ shares, 1e-30 * size.mean() + 1e-300)
    return np.asarray(variance)


def _weights(deviations: Sequence[FloatArray]) -> FloatArray:
    """Return 1/σ of real and imaginary parts of all rows, one after the other."""
    return 1.0 / np.concatenate([np.tile(sigma, 2) for sigma in deviations])


def _left(model: ResponseModel, places: FloatArray, *, weights: FloatArray) -> FloatArray:
    """Return what is left of responses and prior, in standard deviations (F2)."""
    misfit = weights * (_parts(model.responses(places)) - _parts(model.measured))
    return np.concatenate([misfit, model.of_prior(places)])


def _slopes_of_left(model: ResponseModel, places: FloatArray, *, weights: FloatArray) -> FloatArray:
    """Return the derivative of `_left`, shape (n_values, n_parameters)."""
    return np.vstack([(weights * _parts(model.slopes(places))).T, model.prior])


def _within(bounds: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return bounds of where a fit may begin."""
    return bounds[0] + 1e-6, bounds[1] - 1e-6


@dataclass(frozen=True)
class Fit:
    """The fit of responses.

    Attributes:
        model: the model.
        places: the maximum of the posterior, shape (n_parameters,).
        covariance: of the places, shape (n_parameters, n_parameters).
        rows: fitted responses.
        deviations: σ of each of their lines.
        lost: sentence on what the model does not explain; empty: it explains all.
    """

    model: ResponseModel
    places: FloatArray
    covariance: FloatArray
    rows: list[beams.ComplexArray]
    deviations: list[FloatArray]
    lost: str

    def posterior(self, n: int, seed: int) -> statistics.Posterior:
        """Return draws of the first n parameters, within their priors.

        (F2) has a normal prior of each sought key; weights make it the uniform one.
        """
        rng = np.random.default_rng(seed)
        chosen = self.model.parameters[:n]
        draws = rng.multivariate_normal(
            self.places[:n], self.covariance[:n, :n], DRAWS, method="eigh"
        )
        inside = draws[((draws >= 0.0) & (draws <= 1.0)).all(axis=1)]
        draws = inside if len(inside) > DRAWS // 20 else np.clip(draws, 0.0, 1.0)
        values = [
            [parameter.value(place) for parameter, place in zip(chosen, row, strict=True)]
            for row in draws.tolist()
        ]
        # a normal prior over 1 sqrt(12) is at most 4.5 times as dense in the middle as at the ends
        weights = np.exp(0.5 * np.sum(((draws - 0.5) / UNIFORM) ** 2, axis=1))
        return statistics.Posterior(np.array(values), weights / weights.sum())

    @property
    def case(self) -> Case:
        """The fitted case, without the sensors of measured places."""
        fitted = self.model.case_at(self.places)
        sensors = tuple(s for s in fitted.sensor if not s.name.startswith(OF_PLACE))
        return fitted.model_copy(update={"sensor": sensors})


def _found(
    model: ResponseModel,
    bounds: tuple[FloatArray, FloatArray],
    seed: int,
    progress: Progress | None,
) -> FloatArray:
    """Return places near the maximum of the posterior, by the logarithm of the responses."""
    n_keys = len(model.parameters) - model.n_gains
    n_lines = 2 * sum(row.size for row in model.measured)
    trials = np.full((TRIALS, len(model.parameters)), 0.5)
    trials[1:, :n_keys] = np.random.default_rng(seed).uniform(0.02, 0.98, (TRIALS - 1, n_keys))
    costs = []
    for number, trial in enumerate(trials, start=1):
        costs.append(float(np.sum(np.log1p((_logarithms(model, trial) / FAR) ** 2))))
        if progress is not None:
            progress(number, TRIALS)

    def led(start: FloatArray, steps: int) -> Any:
        return least_squares(
            partial(_logarithms, model), np.clip(start, *_within(bounds)),
            partial(_slopes_of_logarithms, model), bounds, loss="cauchy", f_scale=FAR,
            max_nfev=steps, ftol=NEARLY,
        )  # fmt: skip

    nearest: list[Any] = []
    for k in np.argsort(costs)[:LED_ON]:
        nearest.append(led(trials[k], FEW))
        if np.median(np.abs(nearest[-1].fun[:n_lines])) < EXPLAINED:
            break
    return np.asarray(led(min(nearest, key=lambda one: float(one.cost)).x, LONGEST).x)


def fitted(model: ResponseModel, seed: int, progress: Progress | None = None) -> Fit:
    """Return the fit of a model to its measured responses.

    Args:
        model: the model.
        seed: of the cases from the prior.
        progress: told of the trials.
    """
    bounds = (
        np.array([0.0 if p.is_sought else -1.0 for p in model.parameters]),
        np.array([1.0 if p.is_sought else 2.0 for p in model.parameters]),
    )
    places = _found(model.thinned(), bounds, seed, progress)
    for _ in range(ROUNDS):
        weights = _weights(_deviations(model, model.responses(places)))
        places = least_squares(
            partial(_left, model, weights=weights), np.clip(places, *_within(bounds)),
            partial(_slopes_of_left, model, weights=weights), bounds, ftol=SETTLED,
            max_nfev=LONGEST,
        ).x  # fmt: skip
    rows = model.responses(places)
    deviations = _deviations(model, rows)
    covariance = _covariance(model, places, rows, deviations)
    places, covariance = _refined(model, places, covariance, deviations)
    return Fit(model, places, covariance, rows, deviations, _lost(model, rows))


def _covariance(
    model: ResponseModel,
    places: FloatArray,
    rows: Sequence[beams.ComplexArray],
    deviations: Sequence[FloatArray],
) -> FloatArray:
    """Return the covariance of the places: of noise, or of blocks of lines if that is larger."""
    weights = _weights(deviations)
    J = (weights * _parts(model.slopes(places))).T
    left = weights * (_parts(rows) - _parts(model.measured))
    inverse = np.linalg.inv(J.T @ J + model.prior**2)
    blocks = []
    for file in model.files:
        n = file.frequency.size
        count = max(1, min(BLOCKS, n // LEAST_LINES))
        blocks += [np.tile(np.arange(n) * count // n, 2)] * len(file.names)
    sizes = [2 * row.size for row in rows]
    number = np.concatenate(blocks)
    assert number.size == sum(sizes)
    gradients = np.array([J[number == b].T @ left[number == b] for b in np.unique(number)])
    count = len(gradients)
    scatter = count / max(1, count - 1) * gradients.T @ gradients
    sandwich = inverse @ scatter @ inverse
    ratio = np.sqrt(np.maximum(1.0, np.diag(sandwich) / np.diag(inverse)))
    return np.asarray(ratio[:, None] * inverse * ratio)


def _refined(
    model: ResponseModel,
    places: FloatArray,
    covariance: FloatArray,
    deviations: Sequence[FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Return places and covariance without what twice as many elements change.

    Half of the change counts as a standard error.
    """
    elements = model.case.mesh.elements
    if model.case.model.kind != "beam" or elements is None or model.case.is_of_points:
        return places, covariance
    weights = _weights(deviations)
    J = (weights * _parts(model.slopes(places))).T
    change = weights * (
        _parts(model.responses(places, {"mesh.elements": 2 * elements}))
        - _parts(model.responses(places))
    )
    shift = -covariance @ (J.T @ change)
    return places + shift, covariance + 0.25 * np.diag(shift**2)


def _lost(model: ResponseModel, rows: Sequence[beams.ComplexArray]) -> str:
    """Return a sentence on responses of which more is left than their noise; or nothing."""
    sentences = []
    names = [(file, name) for file in model.files for name in file.names]
    known = [row for file in model.files for row in file.deviation]
    for (file, name), row, measured, stated in zip(names, rows, model.measured, known, strict=True):
        if not np.isfinite(stated).all() or not stated.any():
            continue
        ratio = np.sqrt(0.5 * np.abs(row - measured) ** 2) / np.maximum(
            stated, LEAST_SHARE * np.abs(measured)
        )
        size = float(np.sqrt(np.mean(np.minimum(ratio, 1e6) ** 2)))
        if size > UNEXPLAINED:
            at = float(file.frequency[int(np.argmax(ratio))])
            sentences.append(f"{name}: {size:.3g} times its noise is left, most at {at:.4g} Hz.")
    if not sentences:
        return ""
    return " ".join(["The rig is not this model.", *sentences])


def parameters_of(
    case: Case, unknowns: Sequence[Unknown], uncertain: Sequence[Unknown]
) -> list[Parameter]:
    """Return the unknowns of the fit: those sought, then those in which the rig may differ."""
    parameters = [
        Parameter(u.keys(case), u.low, u.high, False, (1.0,) * len(u.keys(case)), is_sought=True)
        for u in unknowns
    ]
    taken = {key for parameter in parameters for key in parameter.keys}
    for unknown in uncertain:
        for key in unknown.keys(case):
            if key in taken:
                continue
            factor = value_of(case, key) if unknown.is_relative else 1.0
            parameters.append(Parameter((key,), unknown.low, unknown.high, True, (factor,)))
    return parameters


def residuals(fit: Fit) -> Figure:
    """Draw measured and fitted responses, and what is left beside the deviation of the lines."""
    names = [
        (file, name, unit)
        for file in fit.model.files
        for name, unit in zip(file.names, file.units, strict=True)
    ]
    figure, grid = style.stacked(2 * len(names), 4.0 * len(names), sharex=False)
    for k, ((file, name, unit), row, measured, sigma) in enumerate(
        zip(names, fit.rows, fit.model.measured, fit.deviations, strict=True)
    ):
        upper, lower = grid[2 * k], grid[2 * k + 1]
        upper.semilogy(
            file.frequency, np.abs(measured), ".", color=style.BLACK, markersize=3,
            label="measured",
        )  # fmt: skip
        upper.semilogy(file.frequency, np.abs(row), color=style.BLUE, label="fitted")
        upper.set_title(name, loc="left")
        upper.set_ylabel(f"|H| [{unit}]")
        style.legend_above(upper)
        lower.semilogy(
            file.frequency, np.abs(row - measured), ".", color=style.VERMILLION, markersize=3,
            label="left",
        )  # fmt: skip
        lower.semilogy(file.frequency, np.sqrt(2.0) * sigma, color=style.GREEN, label="deviation")
        lower.set_ylabel(f"what is left [{unit}]")
        lower.set_xlabel("frequency [Hz]")
        style.legend_above(lower)
    style.label_x(grid, "frequency [Hz]")
    figure.suptitle(f"{fit.model.case.name}: measured and fitted responses")
    return figure


@dataclass(frozen=True)
class ResponseFit(Finding):
    """Posterior of keys of a case from measured frequency responses.

    Attributes:
        case: the case whose keys are sought.
        unknowns: keys that are sought.
        uncertain: keys in which the rig may differ from the case.
        fit: the fit.
        posterior: posterior of the sought keys.
    """

    case: Case
    unknowns: tuple[Unknown, ...]
    uncertain: tuple[Unknown, ...]
    fit: Fit
    posterior: statistics.Posterior

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        words = described(self.case, self.unknowns, self.posterior)
        n = len(self.unknowns)
        errors = np.sqrt(np.diag(self.fit.covariance))
        others: dict[str, dict[str, Any]] = {}
        gains: dict[str, dict[str, Any]] = {}
        names = [name for file in self.fit.model.files for name in file.names]
        for k, parameter in enumerate(self.fit.model.parameters[n:], start=n):
            place = float(self.fit.places[k])
            ends = [parameter.value(place + sign * 1.645 * errors[k]) for sign in (-1.0, 1.0)]
            factor = parameter.factors[0]
            number = {
                "median": factor * parameter.value(place),
                "interval_90": [factor * end for end in ends],
            }
            if parameter.keys:
                others[parameter.keys[0]] = number
            else:
                gains[names[len(gains)]] = number
        left = {
            name: float(np.linalg.norm(row - measured) / np.linalg.norm(measured))
            for name, row, measured in zip(
                names, self.fit.rows, self.fit.model.measured, strict=True
            )
        }
        numbers = {
            "unknowns": words.entries,
            "correlation": self.posterior.correlation(),
            "channels": names,
            "lines": [file.frequency.size for file in self.fit.model.files],
            "residual": left,
            "uncertain": [asdict(unknown) for unknown in self.uncertain],
            "fitted": others,
            "gains": gains,
            "mismatch": self.fit.lost or None,
        }
        rows = ", ".join(f"{name} {100.0 * share:.2g} %" for name, share in left.items())
        return Report(
            name="identification",
            numbers=numbers,
            case=self.case,
            fitted=self.fit.case,
            tables=[words.table],
            sentences=[
                f"{words.sentence} The fit leaves (rms, relative): {rows}. {self.fit.lost}".strip()
            ],
            pictures={
                "posterior": (words.figure, ""),
                "fit": (partial(residuals, self.fit), ""),
            },
        )


def of_responses(
    case: Case,
    files: Sequence[Path],
    unknowns: tuple[Unknown, ...],
    uncertain: tuple[Unknown, ...],
    *,
    names: Sequence[str] = (),
    band: Sequence[float] | None = None,
    seed: int = 1,
    progress: Progress | None = None,
) -> ResponseFit:
    """Infer keys of a case from measured frequency responses.

    Args:
        case: the case.
        files: what `measure response` has written.
        unknowns: keys that are sought.
        uncertain: keys in which the rig may differ from the case; those that are sought are not.
        names: channels that are wanted; none: all that the case has.
        band: lowest and highest frequency [Hz]; None: all that are driven.
        seed: of the cases that are tried at first, and of the draws from the posterior.
        progress: called with the numbers of finished and of all trials.

    Raises:
        CaseError: a file does not fit the case, or a key is not one of numbers.
    """
    require_values(unknowns)
    measured = []
    with_channels = case
    for path in files:
        responses, with_channels = read(path, with_channels, names, band)
        measured.append(responses)
    parameters = parameters_of(case, unknowns, uncertain)
    fit = fitted(ResponseModel(with_channels, measured, parameters), seed, progress)
    posterior = fit.posterior(len(unknowns), seed)
    return ResponseFit(case, unknowns, uncertain, fit, posterior)
