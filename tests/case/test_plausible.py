"""Numbers that look like a mistake in a unit."""

from __future__ import annotations

import logging
import re
import tomllib
from typing import Any

import numpy as np
import pytest

from delam_fem.case.definition import Case
from delam_fem.case.files import PRESETS, preset
from delam_fem.case.keys import case_text
from delam_fem.case.plausible import tell, warnings


def test_of_two_bending_stiffnesses_the_one_that_counts_is_told() -> None:
    data: Any = tomllib.loads(case_text("apart", "mine"))  # which sets EI
    for key in ("density", "young_modulus"):
        del data["lamina"][0][key]
    data["lamina"][0]["material"] = "aluminium"
    case = Case.checked(data, "case")
    assert case.lamina[0].flexural_rigidity == 1.51
    assert warnings(case) == [
        "lamina.thick.bending_stiffness = 1.51 N m2 counts, not the 1.867 N m2 of the material "
        "aluminium; remove the one that is not meant"
    ]
    assert not warnings(case.with_overrides({"lamina.thick.bending_stiffness": None}))


def test_lengths_in_mm_are_named_instead_of_the_frequency() -> None:
    sizes = {"length": 400.0, "width": 20.0, "thickness": 2.0, "bending_stiffness": None}
    keys = {f"lamina.{name}.{key}": v for name in ("thick", "thin") for key, v in sizes.items()}
    found = warnings(preset("paper", keys | {"excitation.frequency": 10.0, "gap.tip": 4.0}))
    assert found == [
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
    found = warnings(preset("paper", {key: value}))
    assert len(found) == 1

    assert re.search(expected, found[0]), found[0]


@pytest.mark.parametrize(("frequency", "lamina"), [(0.00325, 0), (3250.0, 1)])
def test_the_frequency_of_a_lamina_stands_beside_that_of_the_drive(
    frequency: float, lamina: int
) -> None:
    case = preset("paper", {"excitation.frequency": frequency})
    firsts = sorted(own.angular_frequencies(1)[0] / (2.0 * np.pi) for own in case.lamina)
    assert f"first frequency {firsts[lamina]:.3g} Hz" in warnings(case)[0]


def test_lengths_in_mm_are_told() -> None:
    keys = {f"lamina.{name}.length": 685.0 for name in ("thick", "thin")}
    found = warnings(preset("paper", keys))
    assert [text.partition(" = ")[0] for text in found[:2]] == [*keys]
    assert all('did you mean "685 mm"' in text for text in found[:2])


def test_a_warning_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    case = preset("paper", {"gap.tip": 11.75})
    with caplog.at_level(logging.WARNING):
        tell(case)
        tell(case)
    assert len(caplog.records) == 1
