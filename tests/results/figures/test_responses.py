"""The figure of responses to drives with many lines: what it draws, beside exact responses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import delam_fem as df
from delam_fem.api import Case, preset
from delam_fem.results.figures.responses import estimates, exact
from delam_fem.results.figures.run import figures_of

BAND = {"low": 0.8, "high": 6.0}
DRIVES: dict[str, tuple[dict[str, Any], float]] = {
    "multisine": ({"kind": "multisine", **BAND, "spacing": 0.1, "rms": 0.2}, 1e-3),
    "realisations": ({"kind": "multisine", **BAND, "spacing": 0.2, "rms": 0.2, "realisations": 2,
                      "periods": 8}, 1e-3),
    "burst": ({"kind": "burst", **BAND, "rms": 0.2, "duration": 120.0, "share": 0.6}, 2e-3),
    "random": ({"kind": "random", **BAND, "rms": 0.2, "duration": 600.0}, 0.15),
    "force": ({"kind": "multisine", **BAND, "spacing": 0.1, "rms": 0.01, "acts_on": "force",
               "lamina": "thick", "position": 0.3}, 1e-3),
}  # fmt: skip
"""Drives, and the error of H at its peak: of averaged segments of 75 s their Hann window."""


def case_of(drive: dict[str, Any], **more: Any) -> Case:
    """Return the paper's laminae with much damping, without contact, under a drive."""
    periodic = {"periods": 8} if "duration" not in drive and "realisations" not in drive else {}
    keys = {"excitation": drive, "output": {}, "time": {"steps_per_period": 300, **periodic},
            "contact.law": "none", "mesh.elements": 20, "lamina.thick.damping_ratio": 0.05,
            "lamina.thin.damping_ratio": 0.05}  # fmt: skip
    if "duration" in drive:
        keys["time"] = {"steps_per_period": 100}
    return preset("paper", keys | {key.replace("__", "."): v for key, v in more.items()})


@pytest.mark.parametrize("name", DRIVES)
def test_a_linear_run_has_its_exact_responses(name: str) -> None:
    keys, error = DRIVES[name]
    case = case_of(keys)
    result = df.run(case, "compiled")
    values = estimates(result.history, case)
    known = exact(case, values.frequency)
    assert known is not None
    assert set(values.names) == {f"tip_{k}{end}" for k in ("thick", "thin")
                                 for end in ("", "_velocity")}  # fmt: skip
    for channel, H in zip(values.names, values.response, strict=True):
        peak = np.abs(known[channel]).max()
        if name == "random":
            at = int(np.abs(known[channel]).argmax())
            assert abs(abs(H[at]) - peak) < error * peak
        else:
            assert np.abs(H - known[channel]).max() <= error * peak


def test_the_exact_response_of_a_tip_is_that_of_a_cantilever() -> None:
    """u(L)/q = (cos B + cosh B) / (1 + cos B cosh B) without damping, away from resonance."""
    case = case_of(DRIVES["multisine"][0], lamina__thick__damping_ratio=0.0,
                   lamina__thin__damping_ratio=0.0)  # fmt: skip
    known = exact(case, np.array([2.0]))
    assert known is not None
    for lamina in case.lamina:
        rigidity, mass = lamina.flexural_rigidity, lamina.mass_per_length
        B = (mass * (4.0 * math.pi) ** 2 / rigidity) ** 0.25 * lamina.length
        H = (math.cos(B) + math.cosh(B)) / (1.0 + math.cos(B) * math.cosh(B))
        assert known[f"tip_{lamina.name}"][0] == pytest.approx(H, rel=1e-5)


def test_runs_with_many_lines_have_the_figure_and_others_not() -> None:
    case = case_of(DRIVES["multisine"][0] | {"spacing": 0.4}, time__steps_per_period=20,
                   time__periods=2, output__window_periods=2)  # fmt: skip
    history = df.run(case, "compiled").history
    figure = df.run(case, "compiled").plot.responses()
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert [label.replace("\n", " ") for label in labels] == [
        "amplitude of the drive [m]", "amplitude of channels [unit of each]",
        "|H| [unit of each per m]",
    ]  # fmt: skip
    assert len(figure.axes[2].lines) == 8  # estimated and exact, of two laminae's two channels
    assert "responses" in figures_of(history, case)
    harmonic = preset("paper", {"time.periods": 1, "time.steps_per_period": 20, "output": {},
                                "output.fields_per_period": 0})  # fmt: skip
    assert "responses" not in figures_of(df.run(harmonic, "compiled").history, harmonic)
