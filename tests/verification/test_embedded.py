"""A beam with an embedded delamination that is closed at rest: how it claps."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest

import delam_fem as df
from delam_fem import run_sweep
from delam_fem.api import N_BASE, EngineName, assemble, session_of
from delam_fem.numerics.harmonics import harmonic_amplitudes
from delam_fem.studies.modes.frequencies import structure_modes
from delam_fem.studies.sweeps.grid import sweep_of

COARSE: dict[str, object] = {
    "mesh.elements": 20,
    "time.steps_per_period": 200,
    "time.periods": 8,
    "output.window_periods": 8,
    "output.fields_per_period": 0,
}


def run(engine: EngineName = "petsc", **overrides: object) -> df.Result:
    keys = {key.replace("__", "."): value for key, value in overrides.items()}
    case = df.preset("embedded", COARSE | keys)
    return df.run(case, engine, structure=assemble(case, needs_dolfinx=False))


def tips(result: df.Result) -> np.ndarray:
    return np.asarray(result.history["tip_displacement"])


@pytest.fixture(scope="module")
def clapping() -> df.Result:
    return run()


def test_delamination_opens_and_claps_and_the_ledger_closes(clapping: df.Result) -> None:
    gap = tips(clapping)[1] - tips(clapping)[0]
    assert clapping.summary["impacts_per_period"] > 100
    assert gap.max() > 0.1 * np.abs(tips(clapping)).max()
    assert -gap.min() < 0.1 * gap.max()
    assert clapping.summary["energy_residual"] < 1e-9
    assert float(np.asarray(clapping.history["energy_impact_loss"]).min()) >= 0.0


def test_twice_the_excitation_is_exactly_twice_the_motion(clapping: df.Result) -> None:
    twice = run(excitation__acceleration=0.2)
    assert (tips(twice) == 2.0 * tips(clapping)).all()
    assert twice.summary["impacts_per_period"] == clapping.summary["impacts_per_period"]


def test_nothing_opens_without_cause() -> None:
    still = run(excitation__acceleration=0.0)
    assert (tips(still) == 0.0).all()
    assert still.summary["impacts_per_period"] == 0


def test_small_motion_beside_an_opening_is_the_free_linear_one() -> None:
    settings = {"delamination__1__opening": 1e-3, "excitation__acceleration": 0.01}
    apart = run(**settings)
    free = run(**settings, contact__law="none", time__scheme="newmark")
    assert apart.summary["impacts_per_period"] == 0
    assert np.abs(tips(apart) - tips(free)).max() < 1e-11 * np.abs(tips(free)).max()


def test_equal_halves_never_open_and_that_is_said() -> None:
    both = {"lamina__lower__thickness": 0.001, "lamina__upper__thickness": 0.001}
    result = run(**both, time__periods=3, output__window_periods=3)
    gap = tips(result)[1] - tips(result)[0]
    assert np.abs(gap).max() < 1e-9 * np.abs(tips(result)).max()
    (message,) = result.summary["warnings"]
    assert "no delamination ever opens under base motion" in message


def test_overlap_falls_with_the_step() -> None:
    depths = []
    for steps in (200, 800, 3200):
        keys = {"mesh__elements": 10, "time__steps_per_period": steps, "time__periods": 6}
        result = run("compiled", **keys, output__window_periods=3)
        gap = tips(result)[1] - tips(result)[0]
        depths.append(-gap.min() / gap.max())
    assert depths[2] < depths[1] < depths[0] < 0.1
    assert depths[2] < 0.2 * depths[0]


def test_engines_agree_over_the_first_impacts(clapping: df.Result) -> None:
    compiled = run("compiled", time__periods=1, output__window_periods=1)
    first = tips(clapping)[:, :100]
    assert np.abs(tips(compiled)[:, :100] - first).max() < 1e-5 * np.abs(first).max()
    assert np.abs(first).max() > 1e-8


def test_an_interrupted_run_goes_on_bit_for_bit(tmp_path: Path, clapping: df.Result) -> None:
    case = clapping.case
    structure = assemble(case, needs_dolfinx=False)

    def interrupt(period: int, n_periods: int) -> None:
        if period == 3:
            os.kill(os.getpid(), signal.SIGINT)

    first = df.run(case, directory=tmp_path, progress=interrupt, structure=structure)
    assert first.history.attrs["outcome"] == "interrupted"
    complete_run = df.run(case, directory=tmp_path, resume=True, structure=structure)
    assert (tips(complete_run)[:, -200:] == tips(clapping)[:, -200:]).all()


def amplitude(frequency: float, order: int = 1, **overrides: object) -> float:
    """Return the amplitude of a harmonic of the upper lamina in the last periods [m]."""
    keys = {key.replace("__", "."): value for key, value in overrides.items()}
    last = {"time.periods": 120, "output.window_periods": 10}
    case = df.preset("embedded", COARSE | last | keys | {"excitation.frequency": frequency})
    with session_of(
        case, assemble(case, needs_dolfinx=False).operators, engine="compiled"
    ) as opened:
        assert opened.run() == "completed"
        window = opened.recorder.window
    u = np.concatenate([record.u[1:, N_BASE + 1] for record in window])
    return float(harmonic_amplitudes(u[None], len(window))[0, order - 1])


def bilinear() -> float:
    case = df.preset("embedded", {"mesh.elements": 20})
    return float(
        structure_modes(assemble(case, needs_dolfinx=False), case, 1).bilinear_frequencies[0]
    )


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_first_peak_lies_at_the_bilinear_frequency(restitution: float) -> None:
    f = bilinear() + np.array([-0.5, -0.25, 0.0, 0.25, 0.5])
    amplitudes = [amplitude(float(each), contact__restitution=restitution) for each in f]
    assert f[np.argmax(amplitudes)] == pytest.approx(bilinear(), abs=1e-9)
    curve = np.polyfit(f - bilinear(), amplitudes, 2)
    assert abs(-curve[1] / (2.0 * curve[0])) < 0.15  # vertex of the parabola [Hz]


def test_half_of_it_is_a_superharmonic_resonance() -> None:
    half = 0.5 * bilinear()
    below, there, above = (amplitude(f, 2) for f in (half - 1.0, half, half + 1.0))
    assert there > 3.0 * max(below, above)


def test_sweeps_move_a_delamination(tmp_path: Path) -> None:
    keys = {
        **COARSE,
        "time.periods": 3,
        "output.window_periods": 1,
    }
    axis = {"key": "delamination.1.start", "values": [0.1, 0.12, 0.1333]}
    made = sweep_of({"name": "place", "base": "embedded", "set": keys, "axis": [axis]})
    data = run_sweep(made, tmp_path, "serial")
    assert data["start"].attrs["units"] == "m"
    assert data["outcome"].values.tolist() == ["completed"] * 3
    alone = run("compiled", **{
        "delamination__1__start": 0.1333, "time__periods": 3, "output__window_periods": 1,
    })  # fmt: skip
    np.testing.assert_array_equal(data["tip_max"][2], alone.summary["tip_max"])
    data.close()
