"""Refinements judge channels: a linear oscillator with known numbers, an acceleration without."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from support import refusal

import delam_fem as df
from delam_fem.studies.convergence.analysis import verdict

M, K, D, F, OMEGA = 0.5, 800.0, 0.1, 2.0, 2.0 * math.pi * 7.0
"""Mass [kg], spring [N/m], damping ratio, force [N] and its angular frequency [rad/s]."""
POINT = {"name": "one", "mass": M, "stiffness": K, "damping_ratio": D}
AMPLITUDE = F / abs(K - M * OMEGA**2 + 2j * D * math.sqrt(K * M) * OMEGA)
STEPS = (16, 32, 64, 128, 256)


def oscillator(**sensor: Any) -> df.Case:
    """A mass under a force, whose elastic stop is never reached."""
    place = {"lamina": "one", "position": 1.0}
    return df.Case(
        name="one", lamina=[POINT], mesh={"elements": 1}, contact={"law": "penalty"},
        excitation={"kind": "force", **place, "amplitude": F, "frequency": 7.0},
        stop=[{"lamina": "one", "side": "above", "gap": 1.0, "on": "ground", "stiffness": 100.0}],
        sensor=[{"name": "a1", **place, "quantity": "acceleration"} | sensor],
        time={"steps_per_period": 100},
    )  # fmt: skip


def refined(folder: Path, *of: str, case: df.Case | None = None) -> Any:
    settings: dict[str, Any] = {"steps": STEPS, "periods": 30, "workers": 1}
    return df.converge(case or oscillator(), folder, of=of, **settings)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("channel", "exact"),
    [
        ("tip_one", AMPLITUDE),
        ("tip_one_velocity", OMEGA * AMPLITUDE),
        ("a1", OMEGA**2 * AMPLITUDE),
        ("drive", F),
    ],
)
def test_measures_of_a_linear_oscillator(channel: str, exact: float, tmp_path: Path) -> None:
    study = refined(tmp_path, channel, f"{channel}:amplitude")
    assert [q.name for q in study.judged] == [
        f"{channel}:{measure}" for measure in ("min", "max", "rms", "amplitude")
    ]
    levels = study.refinement.along_steps(study.refinement.methods[0], 1)
    errors = []
    for level in levels:
        rms = study.value(level, f"{channel}:rms") * math.sqrt(2.0)
        errors.append(abs(rms / exact - 1.0))
    assert errors[-1] < 1e-3
    if channel != "drive":  # sampled exactly
        assert math.log2(errors[-2] / errors[-1]) == pytest.approx(2.0, abs=0.1)
    said = verdict(study)
    assert said.startswith("Within 1 %")
    (chosen,) = [k for k, level in enumerate(levels) if f" {level.steps} steps per period" in said]
    assert errors[chosen] <= 0.01


def test_an_acceleration_at_a_place_that_is_hit_has_no_limit(tmp_path: Path) -> None:
    """An impulse in one step is an acceleration like 1/Δt, whose rms grows like Δt^(-1/2)."""
    sensor = {"name": "a1", "lamina": "thin", "position": 0.685, "quantity": "acceleration"}
    case = df.preset("paper", {"excitation.frequency": 3.25, "sensor": [sensor]})
    settings: dict[str, Any] = {
        "laws": ["newton@moreau-jean"], "steps": (500, 1000, 2000, 4000), "periods": 4,
        "limit_steps": 16000, "workers": 1,
    }  # fmt: skip
    study = df.converge(case, tmp_path, of=["a1"], **settings)
    level = study.refinement.level(study.refinement.methods[0], 20, 1000)
    assert study.error(level) > 0.5
    said = verdict(study)
    assert said.startswith("No run is known to be within 1 %")
    assert "a1 rms" in said


@pytest.mark.parametrize("order", [1.0, 0.7])
def test_steps_that_are_enough_are_named(order: float, tmp_path: Path) -> None:
    """A number 1 + c N^-p is within 1 % from N = (100 c)^(1/p) on; steps double from the finest."""
    study = df.converge(
        oscillator(), tmp_path, of=["a1:rms"], steps=(16, 32, 64), periods=4, workers=1
    )
    name = study.refinement.methods[0].name
    enough = 700.0
    for result in study.results.values():
        method, _, steps = result.key.split()
        value = 1.0 + 0.01 * (enough / int(steps)) ** order
        result.statistics["a1:rms"] = (value, 0.0)
        assert method in (name, "none")
    assert f"order {order:.1f}, so that about 1024 steps per period" in verdict(study)


def test_periods_that_scatter_are_named(tmp_path: Path) -> None:
    study = df.converge(
        oscillator(), tmp_path, of=["a1:rms"], steps=(16, 32, 64), periods=4, workers=1
    )
    for result in study.results.values():
        result.statistics["a1:rms"] = (1.0, 0.05)
    assert "scatter of 4 periods: take more --periods" in verdict(study)


def test_channels_that_no_level_has_are_refused(tmp_path: Path) -> None:
    for name in ("tip_two", "a1:median", "contact_stop 2"):
        said = refusal(partial(refined, tmp_path, name))
        assert all(word in said for word in (name, "tip_one_velocity", "contact_stop 1"))
    sampled = oscillator(sampling_rate=50.0)
    assert "a1" in refusal(lambda: refined(tmp_path, "a1", case=sampled))
    assert not list(tmp_path.iterdir())


def test_a_channel_of_two_units_is_refused(tmp_path: Path) -> None:
    case = df.preset("paper")
    laws = ["newton-penalty", "newton@moreau-jean"]
    said = refusal(lambda: df.converge(case, tmp_path, laws=laws, of=["contact_thick-thin"]))
    assert all(word in said for word in ("contact_thick-thin", "N s", "sensor"))


def test_a_refinement_goes_on_with_its_channels_alone(tmp_path: Path) -> None:
    refined(tmp_path, "a1")
    case = oscillator()
    settings: dict[str, Any] = {"steps": STEPS, "periods": 30, "workers": 1, "resume": True}
    again = df.converge(case, tmp_path, of=["a1:mean"], **settings)
    assert again.is_complete
    said = refusal(lambda: df.converge(case, tmp_path, of=["drive"], **settings))
    assert "channels" in said
