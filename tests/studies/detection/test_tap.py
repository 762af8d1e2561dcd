"""Taps over a delamination last longer, as those on the layer above it as a spring."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import delam_fem as df
from delam_fem.api import Case
from delam_fem.cli.app import app
from delam_fem.studies.detection.detect import intact
from delam_fem.studies.detection.tap import LEAST, index, lengths, limits, noisy, taps

START, END, CONTACT = 0.16, 0.24, 1e6
LAYER = {"length": 0.4, "width": 0.02, "material": "aluminium", "damping_ratio": 0.002}
BLOW = {"lamina": "upper", "position": 0.1, "mass": 0.05, "velocity": 0.05, "stiffness": CONTACT}

RIGID = {key: value for key, value in BLOW.items() if key != "stiffness"}


def case_of(**sections: Any) -> Case:
    """Return the case of docs/examples/tap.py with fewer elements and steps."""
    data = {
        "name": "tap",
        "lamina": [{"name": "lower", "thickness": 0.02} | LAYER,
                   {"name": "upper", "thickness": 0.002} | LAYER],
        "support": {"start": "clamped", "end": "clamped"},
        "delamination": [
            {"between": ["lower", "upper"], "start": START, "end": END, "opening": 1e-3}
        ],
        "impactor": [BLOW], "mesh": {"elements": 20},
        "excitation": {"kind": "harmonic", "frequency": 200.0, "amplitude": 0.0},
        "contact": {"law": "penalty", "penalty_stiffness": CONTACT},
        "time": {"steps_per_period": 1000, "periods": 1},
    }  # fmt: skip
    return Case(**(data | sections))


def test_the_length_of_half_a_sine_is_known() -> None:
    """8/π² of it, whatever its size, its place, and what comes after it."""
    times = np.linspace(0.0, 1.0, 10001)
    pulses = [size * np.sin(np.pi * (times - at) / 0.2) for size, at in ((1.0, 0.0), (7.0, 0.31))]
    force = np.stack([np.where((times > at) & (times < at + 0.2), pulse, 0.0)
                      for pulse, at in zip(pulses, (0.0, 0.31), strict=True)], axis=1)  # fmt: skip
    force[8000:8100, 1] = 0.5  # another touch
    np.testing.assert_allclose(lengths(force, times), 0.2 * 8.0 / np.pi**2, rtol=0.02)


@pytest.mark.slow
def test_the_index_is_the_spring_of_the_layer_above_it() -> None:
    """k_c / k_d with k_d = 3 EI a³ / (x (a - x))³, and 0 on sound places, in a middle tap."""
    case = case_of()
    result = df.tap(case, spacing=0.02, noise_db=80.0)
    at = dict(zip(result.mark.x.round(3).tolist(), result.mark.values.tolist(), strict=True))
    a, EI = END - START, case.lamina[1].flexural_rigidity
    for x in (0.18, 0.2, 0.22):
        k = 3.0 * EI * a**3 / ((x - START) * (END - x)) ** 3
        longer = math.sqrt((1.0 + at[x]) / (1.0 + CONTACT / k))
        assert 1.0 < longer < 1.15, (x, longer)  # its edges give way, and it has a mass
    assert abs(at[0.08]) < 0.02
    assert result.mark.x[result.mark.is_over].tolist() == pytest.approx([0.18, 0.2, 0.22])
    assert not result.intact_mark.is_over.any()


def test_healthy_plates_are_called_as_rarely_as_promised() -> None:
    """Of 400 with noise of 30 dB about 1 %; without the limit's margin far more."""
    intact_case, x = intact(case_of()), np.linspace(0.02, 0.38, 10)
    times, force = taps(intact_case, "upper", x)
    sound, rng = lengths(force, times), np.random.default_rng(7)
    limit = limits(force, times, 30.0, np.random.default_rng(8)) - LEAST
    called = half = 0
    for _ in range(400):
        values = index(lengths(noisy(force, 30.0, rng), times), sound)
        called += bool((values > limit).any())
        half += bool((values > 0.5 * limit).any())
    assert called <= 14 < half


@pytest.mark.slow
def test_measured_taps_are_judged_whatever_the_hammer(tmp_path: Path) -> None:
    """A harder contact, another velocity and unit, from a table: the ends are the same."""
    case, x = case_of(), np.arange(0.02, 0.39, 0.02)
    hard = case.with_overrides({"impactor.1.stiffness": 1.1e6, "impactor.1.velocity": 0.03})
    times, force = taps(hard, "upper", x)
    table = tmp_path / "taps.csv"
    names = [f"p{k}" for k in range(x.size)]
    rows = noisy(force, 40.0, np.random.default_rng(3)) * 1e-3
    np.savetxt(table, np.column_stack([times, rows]), delimiter=",", comments="",
               header=",".join(["time [s]", *(f"{name} [kN]" for name in names)]))  # fmt: skip
    path = tmp_path / "case.toml"
    path.write_text(case.to_toml())
    channels = [f"--channel={name}={name}:kN@{at:.2f}/upper"
                for name, at in zip(names, x.tolist(), strict=True)]  # fmt: skip
    result = CliRunner().invoke(
        app, ["detect", "tap", str(path), "-o", str(tmp_path / "out"), "--measured", str(table),
              *channels, "--noise-db", "40"],
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    content = json.loads((tmp_path / "out" / "tap.json").read_text())
    assert content["is_measured"] and content["detected"] and not content["intact_called"]
    assert (content["start"], content["end"]) == pytest.approx((0.18, 0.22))
    assert (tmp_path / "out" / "figures" / "tap.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"impactor": []}, "impactor: tap: expected one, given 0"),
        ({"impactor": [BLOW, BLOW]}, "impactor: tap: expected one, given 2"),
        (
            {"impactor": [RIGID], "contact": {"law": "newton"}},
            "impactor.1: tap: expected a stiffness or a radius, as rigid blows last no time",
        ),
        ({"impactor": [BLOW | {"gap": 0.1}]}, "impactor: tap: expected a blow within the run"),
    ],
)
def test_a_case_that_cannot_be_tapped_is_told(sections: dict[str, Any], message: str) -> None:
    with pytest.raises(df.CaseError, match=message):
        df.tap(case_of(**sections), spacing=0.05)


def test_laminae_apart_and_few_points_are_told() -> None:
    with pytest.raises(df.CaseError, match="tap: "):
        df.tap(df.preset("default"))
    with pytest.raises(df.CaseError, match="scan: "):
        df.tap(case_of(), spacing=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_model_that_is_somewhat_stiffer_calls_nothing(factor: float) -> None:
    """What a wrong stiffness makes of sound taps is below `LEAST`, and there is something."""
    intact_case, x = intact(case_of()), np.linspace(0.02, 0.38, 19)
    keys = {
        f"lamina.{lamina.name}.young_modulus": factor * lamina.young_modulus
        for lamina in intact_case.lamina
    }
    (times, model), (_, force) = (
        taps(case, "upper", x) for case in (intact_case, intact_case.with_overrides(keys))
    )
    values = index(lengths(force, times), lengths(model, times))
    assert 0.2 * LEAST < np.abs(values).max() < LEAST
