"""Findings of made-up scans in full: indices, calls, reports and pictures; no two alike."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import golden
import numpy as np
import xarray as xr

from delam_fem.case.files import preset
from delam_fem.results.scan import Shapes
from delam_fem.studies.detection import indices, infer, tap
from delam_fem.studies.detection.detect import (
    Detection,
    Measurement,
    beside_intact,
    common_turns,
    drive_responses,
    per_sample,
    per_shape,
    samples_of,
)
from delam_fem.studies.detection.excitation import ExcitationMap, _judged
from delam_fem.studies.detection.population import (
    Curve,
    Line,
    PodStudy,
    Population,
    Specimen,
    end_error,
    grid,
    logistic,
    roc,
    trials,
)
from delam_fem.studies.options import Scan

Check = Callable[..., None]
TWICE = preset(
    "embedded",
    {
        "mesh.elements": 12,
        "delamination": [
            {"between": ["lower", "upper"], "start": 0.07, "end": 0.15, "opening": 2e-5},
            {"between": ["lower", "upper"], "start": 0.2, "end": 0.31},
        ],
    },
)
X = 0.4 * np.linspace(0.0, 1.0, 21) ** 1.1
ORDERS = (0.5, 1.0, 2.0, 3.0, 4.0)


def waves(*shape: int) -> np.ndarray:
    """Return numbers without a pattern."""
    return np.cos(np.arange(np.prod(shape)) ** 1.3 + 0.2).reshape(shape)


def shapes() -> Shapes:
    """Return shapes with a bump between 0.1 and 0.2 m, and noise that differs between points."""
    values = 1e-3 * (waves(5, X.size) + 1j * waves(X.size, 5).T)
    values[2] += 0.3 * np.exp(-(((X - 0.15) / 0.02) ** 2) + 0.4j)
    values[1] += np.sin(7.0 * X)
    return Shapes(X, 63.0, ORDERS, values, 1e-4 * (1.5 + waves(X.size)), 9.0)


def test_indices_are_the_stored_ones(stored: Check) -> None:
    own, told = shapes(), []
    for name in indices.INDICES:
        for rate in (0.01, 0.2):
            found = indices.mark(name, own, rate)
            told.append(golden.of_object(found, f"{name} {rate}"))
        told.append(golden.of_object(indices.mark(name, replace(own, noise=2e-4)), f"{name} 1"))
        told.append(golden.of_object(indices.mark(name, replace(own, n_lines=math.inf)), name))
    mark = indices.curvature(own)
    told.append(golden.of_object({
        "marked": mark.is_marked, "ends": [mark.start, mark.end], "over": mark.over_limits,
        "contrast": [mark.contrast(0.1, 0.2), mark.contrast(float(X[5]), float(X[9])),
                     mark.contrast(0.0, 0.4), mark.contrast(0.0, 1e-4)],
    }))  # fmt: skip
    again = indices.repeated("curvature", own, 0.004 * (1.0 + X), repetitions=40, seed=3)
    told.append(golden.of_object(again, "repeated"))
    none = indices.repeated("V2", replace(own, values=0.0 * own.values), 1.0, repetitions=20)
    told.append(golden.of_object(none, "nothing"))
    told.append(golden.of_object(indices.repeated("V3", own, 1e-3), "by default"))
    stored("\n".join(told))


def test_modulation_and_drift_are_the_stored_ones(stored: Check) -> None:
    times = 0.3 + np.arange(4000) / 1000.0
    pump, probe = 2.0, 23.0
    parts = {2.0: 1.0, 4.0: 0.2, 21.0: 0.03, 23.0: 0.5, 25.0: 0.07, 24.0: 0.01}
    phase = np.arange(3.0)
    field = sum(a * np.cos(2.0 * np.pi * f * times[:, None] + phase * a) for f, a in parts.items())
    fast = 2.0 * np.pi * (5.0 * times[:, None] + np.array([0.0, 0.05, -0.1]) * times[:, None] ** 2)
    decay = np.exp(-0.5 * times[:, None]) * np.sin(fast)
    found = {
        "ratio": indices.sideband_ratio(np.asarray(field), times, pump, probe),
        "drift": indices.frequency_drift(decay, times),
        "short": indices.frequency_drift(decay[:900], times[:900]),
    }
    stored(golden.of_object(found))


def test_a_measurement_is_the_stored_one(stored: Check) -> None:
    own = Measurement(np.arange(40) / 630.0, X[:6], waves(40, 6), 63.0)
    found = {
        "rms": own.rms,
        "noise": [own.noise_of(Scan()), own.noise_of(Scan(noise_db=26.0, averages=4)),
                  own.noise_of(Scan(noise_density=1e-3, sampling_rate=900.0, averages=3))],
        "samples": [samples_of(Scan(), 63.0), samples_of(Scan(sampling_rate=315.0), 63.0)],
        "noisy": own.noisy(0.1 * np.arange(1.0, 7.0), 5).field,
        "per": [per_shape(0.3, 17), per_sample(0.3, 17)],
        "turns": [common_turns(2.5, 23.0), common_turns(3.0, 12.0)],
        "drive": {str(k): v for k, v in drive_responses(TWICE, "upper", X[2:9], 31.0).items()},
    }  # fmt: skip
    stored(golden.of_object(found))


def detection(**more: object) -> Detection:
    """Return a finding that calls."""
    own, names = shapes(), ("curvature", "V2", "V3", "thd")
    marks = {name: indices.mark(name, own) for name in names}
    quiet = replace(own, values=np.where(np.array(ORDERS)[:, None] == 1.0, own.values, 1e-5))
    sound = {name: indices.mark(name, quiet) for name in names}
    again = indices.Repeated(
        0.83, np.array([0.11, 0.13]), np.array([0.17, 0.2]), np.array([0.12, 0.18])
    )
    found = Detection(TWICE, Scan(), False, "curvature", own, marks, sound, again, 3e-4)
    return replace(found, **more)  # type: ignore[arg-type]


def test_detections_are_the_stored_ones(stored: Check) -> None:
    found = detection()
    stored(golden.of_finding(found.report))
    nothing = np.full(2, np.nan)
    other = detection(
        is_measured=True, index="V3", scan=Scan(quantity="displacement"),
        intact_marks=found.marks, repeated=indices.Repeated(0.1, nothing, nothing, nothing),
    )  # fmt: skip
    stored(golden.of_finding(other.report), ".other")
    thin = preset("default")
    bare = replace(found, case=thin)
    stored(golden.of_finding(bare.report), ".apart")
    own = indices.Mark(X, waves(X.size), 0.3 + X)
    whole = indices.Mark(X, waves(X.size)[::-1], 0.2 + X)
    lone = beside_intact(TWICE, own, whole, title="told", ylabel="index")
    stored(golden.describe(lone), ".beside")


def test_maps_of_excitations_are_the_stored_ones(stored: Check) -> None:
    f = np.array([40.0, 55.0, 70.0, 92.0, 110.0, 131.0])
    visibility = np.array([[0.5, 3.0, 8.0, 20.0, 9.0, 1.0], [2.0, 0.9, 30.0, 50.0, 0.7, 250.0]])
    found = ExcitationMap(
        TWICE, 34.0, f, np.array([0.3, 3.0]), X[1:-1], 3.0 + 2.5 * waves(2, 6, X.size - 2),
        np.array([[1.0, 5.0, 6.0, 7.0, 2.0, 0.2], [3.0, 4.0, 9.0, 3.4, 1.1, 2.0]]), visibility,
        np.array([[0.0, 0.4, 0.9, 1.0, 0.91, 0.2], [0.3, 0.89, 0.95, 1.0, 0.5, 0.97]]),
        np.array([[np.nan, 0.02, 0.003, 0.004, 0.2, 0.1], [0.1, 0.2, 0.004, 0.003, 0.03, 0.0]]),
        np.array([51.0, 142.0, 263.5]), np.array([66.0, 190.0]),
    )  # fmt: skip
    poor = replace(found, calls=0.8 * found.calls, ratios=np.array([math.nan, math.nan]))
    rough = replace(found, error=1.0 + found.error, beam_modes=np.array([1e6]))
    for name, own in {"": found, ".poor": poor, ".rough": rough}.items():
        told = {"avoided": own.is_avoided, "best": own.recommended, "worst": own.worst}
        text = [golden.of_object(told), own.reason]
        stored("\n".join([*text, golden.of_finding(own.report)]), name)
    visible, numbers = _judged(TWICE, replace(shapes(), noise=1e-5), 3e-3, 12.0)
    stored(golden.of_object({"visible": visible, "numbers": numbers}), ".judged")


SPECIMENS = tuple(
    Specimen(0.2 - 0.01 * k, 0.21 + 0.015 * k, 4e-4 + 5e-5 * k, support, f)
    for k in range(1, 6)
    for support, f in (("clamped", 92.0), ("free", 61.0))
)


def population() -> Population:
    """Return shapes of specimens with bumps that grow with their lengths."""
    values = np.zeros((len(SPECIMENS), 3, X.size), dtype=complex)
    for k, own in enumerate(SPECIMENS):
        values[k, 1] = np.sin(7.0 * X + 0.1 * k)
        inside = np.clip((X - own.start) * (own.end - X), 0.0, None)
        values[k, 2] = (40.0 + 9.0 * k) * inside + 1e-4j * X
        values[k, 0] = 1e-3 * X
    rms = 0.5 + 0.1 * np.arange(len(SPECIMENS))
    rms[3] = np.nan
    return Population(SPECIMENS, X, (0.5, 1.0, 2.0), values, rms)


def test_probabilities_of_detection_are_the_stored_ones(stored: Check) -> None:
    a = np.array([0.02, 0.03, 0.05, 0.06, 0.08, 0.11, 0.13])
    hit = np.array([False, False, True, False, True, False, True])
    curve = logistic(a, hit)
    falling = Curve(np.array([1.0, -2.0]), np.eye(2))
    told = {
        "beta": curve.beta, "covariance": curve.covariance, "pod": curve.pod(a),
        "bound": curve.pod(a, 0.95), "lengths": [curve.length(0.9), curve.length(0.5, 0.9)],
        "falling": falling.length(0.9), "always": logistic(a, a > 0.0).beta,
        "apart": logistic(a, a > 0.055).beta,
        "roc": roc(np.array([2.0, 0.4, 1.1, np.nan]), np.array([0.3, 1.1, 0.9])),
        "grid": [[own.start, own.end, own.thickness, own.frequency, own.length]
                 for own in grid(TWICE, ("free", "pinned"), (92.0, 61.0))],
        "supports": "".join(own.support[0] for own in grid(TWICE, ("free", "pinned"), (92.0,))),
    }  # fmt: skip
    found = population()
    own = found.shapes(4, 31.0, np.random.default_rng(3), 11.0)
    told |= {"values": own.values, "noise": own.noise, "lines": own.n_lines, "x": own.x}
    told |= {"first": found.at_first(7).values, "rms": found.at_first(7).rms}
    told |= {"whole": found.at_first(None).rms, "some": found.at_first(7).x}
    judged = trials(TWICE, found, 18.0, seed=4)
    told |= {str(name): judged[name].values for name in judged if name not in ("support",)}
    told |= {"noise of it": judged.attrs["noise_db"], "of ends": end_error(judged)}
    told |= {"without a hit": end_error(judged.isel(specimen=[3]))}
    stored(golden.of_object(told))


def line(support: str, frequency: float, noise: float, k: int, intact: np.ndarray) -> Line:
    """Return a result for a support, frequency and noise."""
    n = 14
    start, length = 0.05 + 0.01 * np.arange(n), 0.4 * np.linspace(0.02, 0.4, n).round(2)
    hit = np.arange(n) * 3 % 7 < k + np.arange(n) / 4
    columns = {
        "start": start, "end": start + length, "length": length, "depth": 1e-4 * np.arange(n),
        "marked_start": np.where(hit, start + 0.003 * k, np.nan),
        "marked_end": np.where(hit, start + length - 0.004, np.nan), "hit": hit,
        "score": 0.2 * np.arange(n) + 0.1 * k,
    }  # fmt: skip
    data = xr.Dataset({name: ("specimen", v) for name, v in columns.items()})
    return Line(
        support, frequency, data.assign_attrs(noise_db=noise), logistic(length, hit), intact
    )


def test_a_study_of_probabilities_is_the_stored_one(stored: Check) -> None:
    some = np.array([0.2, 0.5, 0.7, 1.3, 0.9])
    lines = (
        line("clamped", 92.0, 40.0, 1, some), line("clamped", 61.0, 40.0, 0, np.empty(0)),
        line("free", 92.0, 40.0, 2, some + 0.2), line("free", 92.0, 20.0, 1, some + 0.5),
    )  # fmt: skip
    best = {("clamped", 40.0): 92.0, ("free", 40.0): 92.0, ("free", 20.0): 92.0}
    stored(golden.of_finding(PodStudy(TWICE, lines, best).report))


def test_what_is_known_of_scans_is_the_stored_one(stored: Check) -> None:
    n, rng = 150, np.random.default_rng(5)
    prior = infer.prior_of(preset("embedded"))
    parameters = prior[:, 0] + rng.uniform(size=(n, 3)) * np.ptp(prior, axis=1)
    every = infer.specimens_of(parameters, "pinned", (92.0, 61.0))
    values = np.zeros((2 * n, 2, X.size), dtype=complex)
    for k, own in enumerate(every):
        values[k, 0] = np.sin(7.0 * X + own.frequency)
        inside = np.clip((X - own.start) * (own.end - X), 0.0, None)
        values[k, 1] = 0.02 / own.thickness * inside + 1e-3j * X
    rms = np.full(2 * n, 0.6)
    rms[[4, n + 9]] = np.nan
    runs = Population(tuple(every), X, (1.0, 2.0), values, rms)
    scan = Shapes(X, 92.0, (1.0, 2.0), values[7], 1e-4 * (1.0 + X), 8.0)
    drive = {2.0: 1e-4 * (X + 0.5j)}
    sensors = (infer.Sensor.of(scan, 0.6, drive), infer.Sensor(34.0))
    known = infer.knowledge(runs, parameters, prior, sensors)
    scans = tuple(runs.shapes(k, 45.0, np.random.default_rng(k), 9.0) for k in (7, n + 7))
    posterior = known.posterior(scans)
    odd = tuple(replace(own, values=own.values[:, ::-1] * 40.0) for own in scans)
    told = {
        "sensor": [np.asarray(sensors[0].noise_db), sensors[0].n_lines],
        "frequencies": known.frequencies, "bases": [np.abs(b) for b in known.bases],
        "parameters": known.table.parameters, "n": posterior.samples.shape,
        "of edges": infer.edges(parameters[:3]), "prior": prior,
        "alike": known.mismatch(scans), "unlike": known.mismatch(odd),
        "specimens": [[s.start, s.end, s.thickness, s.frequency] for s in every[:3] + every[-2:]],
    }  # fmt: skip
    stored(golden.of_object(told))


def test_taps_are_the_stored_ones(stored: Check) -> None:
    times = 1e-4 * np.arange(60)
    widths, at = np.array([4.0, 7.0, 11.0, 5.5, 6.1]), np.array([12.0, 20.0, 31.0, 18.0, 2.0])
    force = (3.0 + np.arange(5)) * np.exp(-(((np.arange(60)[:, None] - at) / widths) ** 2))
    force[45:50] += 0.3
    own = tap.lengths(force, times)
    sound = own * (1.0 + 0.02 * waves(5)) / np.array([1.0, 1.0, 1.6, 1.2, 1.0])
    noise = np.random.default_rng(3)
    x = X[3:8]
    limits = tap.limits(force, times, 38.0, noise)
    mark = indices.Mark(x, tap.index(own, sound), limits)
    intact = indices.Mark(x, 0.01 * waves(5), limits)
    found = tap.Taps(TWICE, "upper", False, own, sound, mark, intact)
    noisy = tap.noisy(force, 26.0, noise)
    told = {"lengths": own, "marked": mark.is_over * 1, "intact": intact.is_over * 1}
    told |= {"noisy": noisy, "limits": limits, "many": tap.index(waves(3, 5) + 2.0, sound)}
    stored(golden.of_object(told))
    stored(golden.of_finding(found.report), ".report")
    nothing = replace(found, mark=replace(mark, limits=limits + 9.0), is_measured=True)
    called = replace(found, intact_mark=mark)
    stored("\n".join(own.report.sentences[0] for own in (nothing, called)), ".other")
