import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import delam_fem as df
from delam_fem.api import CaseError, assemble, preset, session_of
from delam_fem.numerics.statistics import Posterior, uniform
from delam_fem.studies.identification.identify import (
    Experiment,
    Identification,
    identify,
    measured_histories,
)
from delam_fem.studies.identification.unknowns import Unknown, drawn, of_rig
from delam_fem.studies.sweeps.point import probe_motion

CASE = {
    "time.mass": "lumped",
    "mesh.elements": 10,
    "time.steps_per_period": 100,
    "time.periods": 15,
    "output.window_periods": 4,
    "output.fields_per_period": 0,
}
UNKNOWNS = (Unknown("lamina.*.damping_ratio", 0.004, 0.05), Unknown("gap.exponent", 1.0, 3.0))


def experiment(frequency: float = 1.25) -> Experiment:
    """Return a small rig whose damping is sought."""
    case = preset("paper", CASE | {"lamina.thick.damping_ratio": 0.02})
    thin = case.with_overrides({"lamina.thin.damping_ratio": 0.02})
    return Experiment(thin, (frequency,), UNKNOWNS, 1e-4, uncertain=of_rig(thin))


def write_tips(path: Path, given: Experiment) -> None:
    """Write the motion of the rig as a table in millimetres that starts at another time."""
    case = given.case.with_overrides({"excitation.frequency": given.frequencies[0]})
    structure = assemble(case, needs_dolfinx=False)
    with session_of(case, structure.operators) as opened:
        opened.run()
        tips = probe_motion(opened.recorder, structure).displacement
    time = 0.07 + case.time_step * np.arange(tips.shape[1])
    noise = given.noise * np.random.default_rng(3).standard_normal(tips.shape)
    np.savetxt(
        path, np.column_stack([time, 1e3 * (tips + noise).T]), delimiter=",",
        header="time [s],tip thick [mm],tip thin [mm]", comments="",
    )  # fmt: skip


@pytest.mark.slow
def test_damping_is_found_from_a_simulated_and_from_a_measured_motion(tmp_path: Path) -> None:
    setup = experiment()
    identification = identify(
        setup, tmp_path / "a", simulations=220, finer=22, checks=100, executor="serial"
    )
    low, high = identification.posterior.interval(0.99)[0]
    assert low < 0.02 < high
    assert high - low < 0.6 * (0.05 - 0.004)
    assert identification.coverage is not None and np.all(identification.coverage >= 0.8)
    paths = identification.save(tmp_path / "a")
    numbers = json.loads(paths[0].read_text())
    entry = numbers["unknowns"]["lamina.*.damping_ratio"]
    assert entry["truth"] == 0.02
    assert entry["interval_90"][0] < entry["median"] < entry["interval_90"][1]
    assert {path.name for path in paths} >= {"posterior.png", "case.toml"}
    assert (tmp_path / "a" / "posterior.png").stat().st_size > 10_000
    assert [row[0] for row in identification.report.tables[0].rows] == [
        unknown.key for unknown in UNKNOWNS
    ]
    write_tips(tmp_path / "tips.csv", setup)
    again = identify(
        setup, tmp_path / "a", measured=[tmp_path / "tips.csv"], simulations=220, finer=22,
        checks=0, executor="serial",
    )  # fmt: skip
    assert again.truth is None
    assert 0.9e-4 < min(again.experiment.noise) < 5e-4  # with the transient, which is no harmonic
    assert again.mismatch is None
    assert again.posterior.quantile(0.5)[0] == pytest.approx(0.02, abs=0.008)


def test_an_experiment_knows_its_keys_and_errors() -> None:
    setup = experiment()
    assert setup.truth == [0.02, 2.0]
    assert UNKNOWNS[0].keys(setup.case) == (
        "lamina.thick.damping_ratio", "lamina.thin.damping_ratio",
    )  # fmt: skip
    assert setup.error == pytest.approx(1e-4 * np.sqrt(2.0 / 400))
    two = replace(setup, channels=("a1", "base"), noise=(1.0, 1e-5))
    assert two.error == pytest.approx(np.array([[1.0], [1e-5]]) * np.sqrt(2.0 / 400))
    with pytest.raises(CaseError, match=r"one for each of a1, base"):
        replace(two, noise=(1.0, 1.0, 1.0))
    drawn = uniform(setup.bounds, 500, 1)
    assert np.all((drawn.min(axis=0) >= [0.004, 1.0]) & (drawn.max(axis=0) <= [0.05, 3.0]))
    assert np.all(np.ptp(drawn, axis=0) > [0.04, 1.9])


def test_motions_without_contact_are_in_proportion_to_their_levels(tmp_path: Path) -> None:
    """A wide gap: three times the amplitude at the same frequency gives three times the motion."""
    single = experiment()
    case = single.case.with_overrides({"gap.tip": 1.0, "time.periods": 6, "mesh.elements": 4})
    setup = replace(single, case=case, frequencies=(1.25, 1.25), levels=(1e-3, 3e-3))
    harmonics = setup.simulate(np.array([setup.truth]), tmp_path, executor="serial")
    assert np.abs(harmonics[0, 0, :, 0]).min() > 1e-4
    np.testing.assert_allclose(harmonics[0, 1], 3.0 * harmonics[0, 0], atol=1e-9)
    shaken = case.with_overrides(
        {"excitation.amplitude": None, "excitation.acceleration": 1e-3 * (2.5 * np.pi) ** 2}
    )
    by_acceleration = replace(setup, case=shaken, levels=(1.0, 3e-3 * (2.5 * np.pi) ** 2))
    again = by_acceleration.simulate(np.array([setup.truth]), tmp_path, executor="serial")
    np.testing.assert_allclose(again[0, 1], harmonics[0, 1], atol=1e-9)
    with pytest.raises(CaseError, match=r"one for each of the 2 motions"):
        replace(setup, levels=(1e-3,))
    with pytest.raises(CaseError, match=r"motions that differ"):
        replace(setup, levels=(1e-3, 1e-3))
    drop = {"excitation.kind": "none", "time.step": 1e-3, "time.duration": 1.0}
    with pytest.raises(CaseError, match=r"harmonic or force of motions"):
        replace(setup, case=preset("paper", drop))


@pytest.mark.parametrize("text", ["gap.exponent", "gap.exponent=3:1", "=1:2", "e=1", "e=a:b"])
def test_a_wrong_unknown_is_refused(text: str) -> None:
    with pytest.raises(CaseError, match=r"KEY=LOW:HIGH with LOW below HIGH"):
        Unknown.parse(text)
    assert Unknown.parse("gap.exponent=1:3") == Unknown("gap.exponent", 1.0, 3.0)
    multiples = Unknown.parse("gap.exponent=0.5x:2x")
    assert multiples == Unknown("gap.exponent", 0.5, 2.0, is_relative=True)
    with pytest.raises(CaseError, match=r"gap.exponent: .*given multip"):
        Experiment(preset("paper"), (1.25,), (multiples,), 1e-4)


def test_what_is_not_sought_is_drawn_on_a_logarithmic_scale() -> None:
    case = preset("embedded")
    samples = drawn(of_rig(case), case, 4000, 1)
    assert set(samples) == {
        *(f"lamina.{name}.{key}" for name in ("lower", "upper")
          for key in ("young_modulus", "damping_ratio")),
        "support.rotational_stiffness",
    }  # fmt: skip
    np.testing.assert_array_equal(
        samples["lamina.lower.damping_ratio"], samples["lamina.upper.damping_ratio"]
    )
    for key, low, high in (
        ("lamina.lower.young_modulus", 0.9 * 70e9, 1.1 * 70e9),
        ("lamina.lower.damping_ratio", 0.0025, 0.01),
        ("support.rotational_stiffness", 50 * 2.3333, 5000 * 2.3333),  # EI/L = 0.9333 N m2 / 0.4 m
    ):
        values = samples[key]
        assert values.min() == pytest.approx(low, rel=0.01)
        assert values.max() == pytest.approx(high, rel=0.01)
        assert np.median(values) == pytest.approx(np.sqrt(low * high), rel=0.1)
    assert len(of_rig(preset("paper"))) == 2  # laminae that are apart have rigid clamps
    with pytest.raises(CaseError, match=r"uncertain: gap.exponent: expected values above 0"):
        drawn((Unknown("gap.exponent", 0.0, 1.0),), case, 3, 1)


def test_what_finer_steps_change_is_added_from_simulations_that_are_alike() -> None:
    rng = np.random.default_rng(4)
    setup = experiment()
    parameters = uniform(setup.bounds, 400, 1)
    harmonics = np.zeros((400, 1, 2, 5), dtype=complex)
    harmonics[..., 0, 0] = 1.0  # so that the phase does not turn
    share = (parameters[:, 1] - 1.0) / 2.0
    finer = harmonics[:100] + share[:100, None, None, None] * np.eye(2, 5, 2)
    changes = setup.table(harmonics, parameters, 1, finer).statistics[:, 2]
    assert changes.min() >= -1e-3
    assert np.corrcoef(changes, share)[0, 1] > 0.5
    assert changes[share > 0.8].mean() == pytest.approx(0.9 * 0.75, rel=0.15)  # half of 1.5 times
    assert np.abs(setup.table(harmonics, parameters, 1).statistics[:, 2]).max() < 1e-4
    finer[rng.random(100) < 0.5] = np.nan  # these diverged
    assert np.isfinite(setup.table(harmonics, parameters, 1, finer).statistics).all()


def test_files_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="one file per frequency, given 2 files and 1 freq"):
        identify(experiment(), tmp_path / "a", measured=[tmp_path / "x.csv"] * 2)
    path = tmp_path / "one.csv"
    path.write_text("time [s],tip thick [m]\n" + "".join(f"{k / 10},0\n" for k in range(60)))
    with pytest.raises(CaseError, match="channels tip_thick, tip_thin, found no tip_thin"):
        measured_histories(path, experiment().names)


def test_every_draw_has_a_seed_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The parameters, what else may differ, the noise of the measurement and of the simulations."""
    seeds: list[int] = []
    generator = np.random.default_rng

    def noted(seed: int) -> np.random.Generator:
        seeds.append(seed)
        return generator(seed)

    def simulated(own: Experiment, parameters: np.ndarray, *_: object, **__: object) -> np.ndarray:
        ramp = np.linspace(1.0, 2.0, 10).reshape(1, 1, 2, 5)
        return 1e-3 * (1.0 + parameters[:, :1, None, None]) * ramp * np.exp(1j * ramp)

    monkeypatch.setattr(np.random, "default_rng", noted)
    monkeypatch.setattr(Experiment, "simulate", simulated)
    identify(experiment(), tmp_path, simulations=110, finer=0, checks=0, seed=7)
    assert seeds[:4] == [7, 10, 8, 9]


@pytest.mark.parametrize(
    ("shares", "identified"),
    [((0.4, 0.4), [True, True]), ((0.6, 0.4), [False, True]), ((1.0, 1.0), [False, False])],
)
def test_an_interval_as_wide_as_the_prior_identifies_nothing(
    shares: tuple[float, float], identified: list[bool]
) -> None:
    """Posteriors that fill a share of the prior; half is the limit."""
    setup = experiment()
    low, high = setup.bounds.T
    spread = np.random.default_rng(5).uniform(-0.5, 0.5, size=(4000, 2)) * shares
    samples = 0.5 * (low + high) + spread * (high - low)
    posterior = Posterior(samples, np.full(4000, 1 / 4000))
    report = Identification(setup, posterior, None, 0, False, 4000).report
    about = report.numbers["unknowns"]
    assert [about[unknown.key]["identified"] for unknown in UNKNOWNS] == identified
    text = " ".join(report.sentences)
    assert ("separate" in text) == all(identified)
    for unknown, is_identified in zip(UNKNOWNS, identified, strict=True):
        assert (unknown.key in text) != is_identified
    words = [row[4] for row in report.tables[0].rows]
    assert words == ["yes" if one else "no" for one in identified]


@pytest.mark.slow
@pytest.mark.parametrize("channel", ["a1", "cell", "tip_one_velocity"])
def test_stiffness_is_found_from_any_channel(tmp_path: Path, channel: str) -> None:
    """A mass on a spring whose stiffness is sought; its stop presses through a load cell."""
    place = {"lamina": "one", "position": 1.0}
    case = df.Case(
        name="one", lamina=[{"name": "one", "mass": 0.5, "stiffness": 800.0, "damping_ratio": 0.1}],
        mesh={"elements": 1}, contact={"law": "penalty"},
        excitation={"kind": "force", **place, "amplitude": 2.0, "frequency": 7.0},
        stop=[{"lamina": "one", "side": "above", "gap": 1e-3, "on": "ground", "stiffness": 900.0}],
        sensor=[{"name": "a1", **place, "quantity": "acceleration"},
                {"name": "cell", "quantity": "contact force", "stop": 1}],
        time={"steps_per_period": 200, "periods": 20},
        output={"window_periods": 4, "fields_per_period": 0},
    )  # fmt: skip
    noise = {"a1": 0.05, "cell": 0.01, "tip_one_velocity": 1e-3}[channel]
    unknown = (Unknown("lamina.one.stiffness", 600.0, 1000.0),)
    setup = Experiment(case, (7.0,), unknown, noise, channels=(channel, "drive"))
    setup = replace(setup, noise=(noise, 1e-3))
    identification = identify(
        setup, tmp_path, simulations=200, finer=0, checks=0, executor="serial"
    )
    low, high = identification.posterior.interval(0.99)[0]
    assert low < 800.0 < high
    assert high - low < 200.0  # half of the prior
    assert identification.report.numbers["channels"] == (channel, "drive")
