"""Numbers that look like a mistake in a unit."""

from __future__ import annotations

import logging
import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from delam_fem.api import PRESETS, Case, FloatArray, preset
from delam_fem.case.plausible import tell, warnings


def test_a_narrower_strip_beside_the_bending_stiffness_of_another_is_told() -> None:
    case = preset("paper", {"lamina.thick.width": 0.025})
    [text] = warnings(case)
    assert "lamina.thick.bending_stiffness = 1.51" in text
    assert f"{58.5e9 * 0.025 * 0.002**3 / 12.0:.4g} N m2" in text
    assert not warnings(case.with_overrides({"lamina.thick.bending_stiffness": None}))


def test_a_measured_stiffness_replaces_that_of_a_material_without_a_warning() -> None:
    case = preset("paper", {"lamina.thick.material": "aluminium"})
    case = case.with_overrides({"lamina.thick.bending_stiffness": 1.51})
    assert case.lamina[0].flexural_rigidity == 1.51
    assert not warnings(case)


def test_a_mass_per_length_unlike_that_of_the_material_is_told() -> None:
    keys = {"lamina.thick.material": "steel", "lamina.thick.bending_stiffness": None}
    case = preset("paper", keys)
    data = tomllib.loads(case.to_toml())
    weighed = 7850.0 * 0.04 * 0.002
    for share, count in ((0.96, 0), (1.04, 0), (0.94, 1), (1.06, 1)):
        data["lamina"][0]["mass_per_length"] = share * weighed
        texts = warnings(Case(**data))
        assert len(texts) == count
        assert all("lamina.thick.mass_per_length" in text and "steel" in text for text in texts)


def test_lengths_in_mm_are_named_instead_of_the_frequency() -> None:
    sizes = {"length": 400.0, "width": 20.0, "thickness": 2.0, "bending_stiffness": None}
    keys = {f"lamina.{name}.{key}": v for name in ("thick", "thin") for key, v in sizes.items()}
    texts = warnings(preset("paper", keys | {"excitation.frequency": 10.0, "gap.tip": 4.0}))
    assert texts == [
        f"lamina.{name}: length = 400 m, width = 20 m and thickness = 2 m look unusual; did you "
        'mean "400 mm", "20 mm" and "2 mm"?'
        for name in ("thick", "thin")
    ]


@pytest.mark.parametrize("name", PRESETS)
def test_no_preset_warns(name: str) -> None:
    assert warnings(preset(name)) == []


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("lamina.thick.thickness", 2.0, 'lamina.thick.thickness = 2 m .* "2 mm"'),
        ("lamina.thick.density", 2.68, 'density = 2.68 kg/m3 .* "2.68 g/cm3"'),
        ("lamina.thick.young_modulus", 58.5, 'young_modulus = 58.5 Pa .* "58.5 GPa"'),
        ("lamina.thick.young_modulus", 58500.0, 'young_modulus = 58500 Pa .* "58500 MPa"'),
        ("lamina.thick.damping_ratio", 0.8, 'damping_ratio = 0.8 looks .* "0.8 %"'),
        ("gap.tip", 12.0, r'gap.tip = 12 m looks .* is 17.5, above 0.2; did you mean "12 mm"'),
        ("gap.root", 0.5, 'gap.root = 0.5 m .* "0.5 mm"'),
        ("excitation.amplitude", 2.5, 'excitation.amplitude = 2.5 m .* "2.5 mm"'),
        ("excitation.frequency", 3250.0, 'excitation.frequency = 3250 Hz .* "3250 mHz"'),
        ("excitation.frequency", 0.00325, 'excitation.frequency = 0.00325 Hz .* "0.00325 kHz"'),
        ("point_mass", [{"lamina": "thin", "mass": 5.0}], 'point_mass.1.mass = 5 kg .* "5 g"'),
    ],
)
def test_one_number_gives_one_warning(key: str, value: object, expected: str) -> None:
    texts = warnings(preset("paper", {key: value}))
    assert len(texts) == 1

    assert re.search(expected, texts[0]), texts[0]


@pytest.mark.parametrize(("frequency", "lamina"), [(0.00325, 0), (3250.0, 1)])
def test_the_frequency_of_a_lamina_stands_beside_that_of_the_drive(
    frequency: float, lamina: int
) -> None:
    case = preset("paper", {"excitation.frequency": frequency})
    firsts = sorted(lamina.angular_frequencies(1)[0] / (2.0 * np.pi) for lamina in case.lamina)
    assert f"first frequency {firsts[lamina]:.3g} Hz" in warnings(case)[0]


def test_lengths_in_mm_are_told() -> None:
    keys = {f"lamina.{name}.length": 685.0 for name in ("thick", "thin")}
    texts = warnings(preset("paper", keys))
    assert [text.partition(" = ")[0] for text in texts[:2]] == [*keys]
    assert all('did you mean "685 mm"' in text for text in texts[:2])


def test_a_warning_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    case = preset("paper", {"gap.tip": 11.75})
    with caplog.at_level(logging.WARNING):
        tell(case)
        tell(case)
    assert len(caplog.records) == 1


ONE = {"lamina.thick.length": 0.5, "lamina.thin.length": 0.5, "lamina.thick.width": 0.05,
       "lamina.thick.thickness": 0.01, "lamina.thick.bending_stiffness": None,
       "lamina.thick.density": 1000.0, "lamina.thick.young_modulus": 1e10,
       "lamina.thin.thickness": 0.005, "lamina.thin.bending_stiffness": None}  # fmt: skip
"""Round numbers, with which nothing is unusual."""


def told_of(**changed: object) -> list[str]:
    keys = ONE | {key.replace("__", "."): value for key, value in changed.items()}
    return warnings(preset("paper", keys))


@pytest.mark.parametrize(
    ("key", "inside", "outside", "what"),
    [
        ("lamina.thick.thickness", 0.05, 0.0501, "length over thickness is 9.98, below 10"),
        ("lamina.thick.density", 20.0, 19.9, "the density is 19.9, below 20"),
        ("lamina.thick.density", 23e3, 23.1e3, "the density is 2.31e+04, above 23000"),
        ("lamina.thick.young_modulus", 4e7, 3.9e7, "the wave speed sqrt(E/rho) in m/s is 197, below"
         " 200"),
        ("lamina.thick.young_modulus", 4e11, 4.1e11, "the wave speed sqrt(E/rho) in m/s is 2.02e+04"
         ", above 20000"),
        ("lamina.thick.damping_ratio", 0.2, 0.201, "the damping ratio is 0.201, above 0.2"),
        ("gap.tip", 0.1, 0.101, "the gap over the length is 0.202, above 0.2"),
        ("gap.root", 0.1, 0.101, "the gap over the length is 0.202, above 0.2"),
        ("excitation.amplitude", 0.05, 0.051, "the amplitude over the length is 0.102, above 0.1"),
    ],
)  # fmt: skip
def test_each_bound_is_met_on_both_sides(
    key: str, inside: float, outside: float, what: str
) -> None:
    of_lamina = {"excitation.frequency": 3.0} if "lamina" not in key else {}
    assert not [text for text in told_of(**of_lamina, **{key: inside}) if key in text]
    [text] = [text for text in told_of(**of_lamina, **{key: outside}) if key in text]
    assert what in text and text.startswith(f"{key} = {outside:g}")


def test_frequencies_are_judged_beside_the_first_ones() -> None:
    case = preset("paper", ONE)
    low, high = sorted(lamina.angular_frequencies(1)[0] / (2.0 * np.pi) for lamina in case.lamina)
    for value, first, end in ((0.01 * low, low, 0.99), (250.0 * high, high, 1.01)):
        assert told_of(excitation__frequency=value * (1.0 + (1.0 - end) * 1e-3)) == []
        [text] = told_of(excitation__frequency=value * end)
        ratio = value * end / first
        limit = "above 250" if end > 1.0 else "below 0.01"
        assert (
            f"its ratio to the first frequency {first:.3g} Hz of a lamina alone is {ratio:.3g}, "
            f"{limit}" in text
        )
    sweep = {"kind": "sweep", "start_frequency": 1e-3 * low, "end_frequency": 400.0 * high,
             "duration": 1.0, "amplitude": 0.06}  # fmt: skip
    texts = told_of(excitation=sweep, output={})
    assert [text.split(" = ")[0] for text in texts] == [
        "excitation.amplitude", "excitation.start_frequency", "excitation.end_frequency",
    ]  # fmt: skip
    force = {"kind": "force", "lamina": "thin", "position": 0.1, "amplitude": 9.0, "frequency":
             1e-3 * low}  # fmt: skip
    assert [text.split(" = ")[0] for text in told_of(excitation=force)] == ["excitation.frequency"]


def test_masses_and_blows_are_judged() -> None:
    full_mass = 1000.0 * 0.05 * 0.01 * 0.5
    mass = {"lamina": "thick", "position": 0.1}
    assert told_of(point_mass=[{**mass, "mass": 20.0 * full_mass}]) == []
    [text] = told_of(point_mass=[{**mass, "mass": 0.1}, {**mass, "mass": 20.1 * full_mass}])
    assert text == (
        f"point_mass.2.mass = {20.1 * full_mass:g} kg looks unusual: its ratio to the mass of the "
        f'lamina is 20.1, above 20; did you mean "{20.1 * full_mass:g} g"?'
    )
    blow = {"kind": "hammer", "lamina": "thin", "position": 0.1, "amplitude": 9.0, "duration": 2e-3}
    time = {"time.step": 1e-4, "time.duration": 0.1, "output": {}}
    assert told_of(excitation=blow, **time) == []
    [text] = told_of(excitation=blow, **(time | {"time.step": 1.1e-4}))
    assert text == ("time.step = 0.00011 s is long: the blow of 0.002 s has 18.2 steps, below 20")


@pytest.mark.parametrize(
    ("key", "value", "hint"),
    [
        ("lamina.thick.thickness", 0.9, "mm"), ("lamina.thick.thickness", 90.0, "µm"),
        ("lamina.thick.thickness", 900.0, "µm"), ("gap.tip", 9.0, "mm"), ("gap.tip", 200.0, "µm"),
        ("gap.tip", 2e5, ""), ("lamina.thick.damping_ratio", 0.3, "%"),
        ("lamina.thick.density", 1e9, ""), ("lamina.thick.density", 2.0, "g/cm3"),
        ("lamina.thick.young_modulus", 0.1, "GPa"), ("lamina.thick.young_modulus", 1e-9, ""),
    ],
)  # fmt: skip
def test_units_that_would_be_plausible_are_named(key: str, value: float, hint: str) -> None:
    [text] = [line for line in told_of(**{key: value}) if line.startswith(key)]
    number = f"{value:g}"
    assert text.partition("; ")[2] == (f'did you mean "{number} {hint}"?' if hint else "")


def test_thin_laminae_and_openings_are_named() -> None:
    assert told_of(lamina__thick__thickness=2.5e-5, excitation__frequency=0.5) == []
    [text] = told_of(lamina__thick__thickness=2.49e-5, excitation__frequency=0.5)
    assert text == (
        "lamina.thick.length = 0.5 m looks unusual: length over thickness is 2.01e+04, above 20000;"
        ' did you mean "0.5 mm"?'
    )
    delaminated = preset("embedded", {"delamination.1.opening": 0.5})
    assert [text.split(" looks")[0] for text in warnings(delaminated)] == [
        "delamination.1.opening = 0.5 m"
    ]


def test_a_stiffness_beside_a_modulus_may_differ_by_a_twentieth() -> None:
    EI = 70e9 * 0.05 * 0.01**3 / 12.0
    case = preset("paper", ONE | {"lamina.thick.young_modulus": 70e9})
    for share, count in ((0.96, 0), (1.04, 0), (0.94, 1), (1.06, 1)):
        keys = {"lamina.thick.bending_stiffness": share * EI}
        assert len(warnings(case.with_overrides(keys))) == count


def shaken(tmp_path: Path, course: Callable[[FloatArray], FloatArray], unit: str) -> list[str]:
    """Return the warnings for a base that follows a table of two seconds."""
    time = np.linspace(0.0, 2.0, 401)
    rows = [
        f"{t!r}, {value!r}" for t, value in zip(time.tolist(), course(time).tolist(), strict=True)
    ]
    file = tmp_path / "base.csv"
    file.write_text(f"time [s], value [{unit}]\n" + "\n".join(rows), encoding="utf-8")
    return warnings(
        preset("default", {
            "excitation": {"kind": "table", "file": str(file), "acts_on": "base"},
            "time": {"scheme": "moreau-jean", "step": 1e-3}, "output": {},
        })
    )  # fmt: skip


def test_accelerations_with_an_offset_move_the_base_away(tmp_path: Path) -> None:
    """The base that is at rest at both ends of 2 s of 0.3 g has gone a T^2 / 8 = 1.47 m."""
    a = 0.3 * 9.81
    [text] = shaken(tmp_path, lambda time: np.full_like(time, a), "m/s2")
    assert "excitation.file" in text
    assert f"{a * 2.0**2 / 8.0:.3g} m" in text
    assert f"{a:.3g} m/s2" in text


@pytest.mark.parametrize(("amplitude", "count"), [(0.06, 0), (0.08, 1)])
@pytest.mark.parametrize("unit", ["m", "m/s2"])
def test_a_table_may_move_the_base_by_a_tenth_of_the_length(
    tmp_path: Path, amplitude: float, count: int, unit: str
) -> None:
    """A tenth is 0.0685 m; whole periods have the mean 0."""
    w = 2.0 * np.pi * 2.0
    size = amplitude if unit == "m" else -amplitude * w**2
    texts = shaken(tmp_path, lambda time: size * np.sin(w * time), unit)
    assert len(texts) == count


@pytest.mark.parametrize(("acceleration", "count"), [(24.0, 0), (30.0, 1)])
def test_an_acceleration_at_a_low_frequency_moves_the_base_far(
    acceleration: float, count: int
) -> None:
    """A = a / (2 pi f)^2 is a tenth of 0.685 m at 27 m/s2 and 3.16 Hz."""
    keys = {"excitation.acceleration": acceleration, "excitation.frequency": 3.16}
    texts = warnings(preset("default", keys))
    assert len(texts) == count
    assert all("excitation.acceleration" in text for text in texts)
