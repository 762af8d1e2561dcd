"""Exported runs are read back as the channels of their record, and agree with it as overlays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

import delam_fem as df
from delam_fem.api import CaseError
from delam_fem.studies.signals import reading
from delam_fem.studies.signals.responses import with_free_vibrations

DIGITS = {"csv": 0.0, "mat": 0.0, "uff": 1e-11}
"""Relative tolerance of values: universal files have twelve digits."""
STRIP = {"length": 0.3, "width": 0.02, "density": 2700.0, "young_modulus": 70e9,
         "damping_ratio": 0.01}  # fmt: skip
SLAP = {"name": "slap", "quantity": "contact force"}


def two_strips() -> df.Result:
    """Return a run of two strips that chatter near the clamp, and a stop: as many contacts."""
    case = df.Case(
        name="strips",
        lamina=[
            {"name": "thick", "thickness": 0.002, **STRIP},
            {"name": "thin", "thickness": 0.001, **STRIP},
        ],
        gap={"tip": 0.002},
        mesh={"elements": 8},
        excitation={"kind": "harmonic", "frequency": 9.0, "amplitude": 0.001},
        contact={"law": "newton", "restitution": 0.4, "impulse": "consistent"},
        stop=[{"lamina": "thin", "position": 0.3, "side": "above", "gap": 0.001,
               "stiffness": 2000.0}],
        sensor=[{**SLAP, "between": ["thick", "thin"]}],
        time={"steps_per_period": 1000, "periods": 10},
        output={"window_periods": 5, "fields_per_period": 2},
    )  # fmt: skip
    return df.run(case, "compiled")


def one_strip() -> df.Result:
    """Return a run of one strip with as many frames as nodes, and an impactor."""
    case = df.Case(
        name="strip",
        lamina=[{"name": "strip", "thickness": 0.002, **STRIP}],
        mesh={"elements": 8},
        excitation={"kind": "force", "lamina": "strip", "position": 0.2, "amplitude": 1.0,
                    "frequency": 40.0},
        impactor=[{"lamina": "strip", "mass": 0.02, "position": 0.1, "side": "above",
                   "gap": 0.0005, "velocity": 1.0, "stiffness": 1e5}],
        sensor=[{**SLAP, "impactor": 1}],
        contact={"law": "newton", "impulse": "consistent"},
        time={"steps_per_period": 1000, "periods": 4},
        output={"window_periods": 1, "fields_per_period": 9},
    )  # fmt: skip
    return df.run(case, "compiled")


def compared_names(format_name: str, names: Sequence[str]) -> list[str]:
    """Return names of what a file counts itself: MATLAB's file has no number of a single row."""
    return [n.removesuffix(" 1") if format_name == "mat" else n for n in names]


@pytest.mark.parametrize("format_name", DIGITS)
@pytest.mark.parametrize("run", [two_strips, one_strip])
def test_an_exported_run_is_read_as_its_record(
    run: Callable[[], df.Result], format_name: str, tmp_path: Path
) -> None:
    result = run()
    [file, *_] = result.export(format_name, tmp_path / f"run.{format_name}")
    back = reading.record(df.read_measured(file))
    for name, channel in result.record.data_vars.items():
        np.testing.assert_allclose(
            back[name], channel, rtol=DIGITS[format_name],
            atol=DIGITS[format_name] * float(np.abs(channel).max()), err_msg=str(name),
        )  # fmt: skip
        assert back[name].attrs["units"] == channel.attrs["units"]
    others = set(map(str, back.data_vars)) - set(map(str, result.record.data_vars))
    expected = ["impactor_displacement 1", "impactor_velocity 1", "base"]
    assert others <= set(compared_names(format_name, expected))


def test_an_exported_run_over_itself_agrees_whatever_chatters(tmp_path: Path) -> None:
    result = two_strips()
    [file, *_] = result.export("csv", tmp_path / "run.csv")
    overlay = df.overlay(result, file)
    assert not overlay.findings
    assert not overlay.pairs.unmatched
    gains = {channel.name: channel.gain for channel in overlay.channels}
    assert gains == pytest.approx(dict.fromkeys(gains, 1.0), abs=1e-9)
    assert "sensor_slap" in gains


def test_a_history_is_named_as_in_the_file_or_as_in_the_record(tmp_path: Path) -> None:
    result = two_strips()
    result.save_numbers(tmp_path / "run")
    data = df.read_measured(tmp_path / "run" / "result.nc")
    numbers = {name: reading.history_named(data, name, "option") for name in result.record}
    for name, number in numbers.items():
        assert np.array_equal(reading.history_of(data, number), result.record[name])
    in_file = [str(data["channel"].to_numpy()[number]) for number in numbers.values()]
    assert [reading.history_named(data, name, "option") for name in in_file] == [*numbers.values()]
    with pytest.raises(CaseError, match=r"option: expected one of the histories tip_.*'gap0'"):
        reading.history_named(data, "gap0", "option")
    with pytest.raises(CaseError, match=r"run: expected a file, given a folder.*result\.nc"):
        df.read_measured(tmp_path / "run")
    by_record = with_free_vibrations(data, "tip_thin", 20.0, 300.0, 0.2)
    by_file = with_free_vibrations(data, "tip_displacement thin", 20.0, 300.0, 0.2)
    assert by_record.equals(by_file)
