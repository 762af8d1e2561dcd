"""Values with units: pint's names in, SI numbers out."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from delam_fem.api import Case, CaseError, in_si, preset, tables
from delam_fem.case.sections import SENSOR_UNITS
from delam_fem.case.toml import parse_override
from delam_fem.case.values import Unit

LAMINA = {
    "name": "thick", "length": "685 mm", "width": "4 cm", "thickness": "2mm",
    "density": "2.68 g/cm3", "young_modulus": "58.5 GPa", "damping_ratio": "0.8 %",
}  # fmt: skip


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("2 mm", "m", 0.002),
        ("685 mm", "m", 0.685),  # 685 * 0.001 of doubles too; 0.1 µm is not
        ("0.1 µm", "m", 1e-7),
        ("1 inch", "m", 0.0254),
        ("70 GPa", "Pa", 7e10),
        ("3.25 Hz", "Hz", 3.25),
        ("2 kHz", "Hz", 2000.0),
        ("2.7 g/cm3", "kg/m3", 2700.0),
        ("2680 kg/m**3", "kg/m3", 2680.0),
        ("1.51 N m2", "N m2", 1.51),
        ("0.1 N/mm", "N/m", 100.0),
        ("9.81 m/s^2", "m/s2", 9.81),
        ("2 g_0", "m/s2", 19.6133),
        ("0.8 %", "1", 0.008),
        ("1.5e-1 mm/s", "m/s", 1.5e-4),
        (2.5, "m", 2.5),
        ("two", "m", "two"),
        ("2", "m", "2"),
        (None, "m", None),
        ("9**9**9 m", "m", "9**9**9 m"),
    ],
)
def test_si(text: object, unit: str, expected: object) -> None:
    assert in_si(text, unit) == expected


def test_a_case_with_units_is_the_case_in_si() -> None:
    plain = preset("paper")
    thick = {**LAMINA, "bending_stiffness": "1.51 N m2"}
    with_units = preset(
        "paper",
        {
            "lamina": [thick, plain.lamina[1].model_dump()],
            "gap.tip": "12 mm",
            "excitation.frequency": "3.25 Hz",
            "excitation.amplitude": "2.5 mm",
            "contact.penalty_stiffness": "0.1 N/mm",
            "contact.threshold_velocity": "0.5 mm/s",
        },
    )
    assert with_units.to_toml() == plain.to_toml()
    assert Case.from_toml(with_units.to_toml()) == plain


def test_units_on_the_command_line() -> None:
    key, value = parse_override("lamina.thick.thickness=2 mm")
    assert preset("paper", {key: value}) == preset("paper")
    key, value = parse_override('excitation.frequency="1.6 Hz"')
    assert preset("paper", {key: value}).excitation.top_frequency == 1.6


def test_a_quantity_of_pint_is_taken() -> None:
    import pint

    thickness = pint.UnitRegistry().Quantity(2.0, "mm")
    assert preset("paper", {"lamina.thick.thickness": thickness}) == preset("paper")


def test_numbers_that_follow_from_others_see_si() -> None:
    keys = {k: v for k, v in LAMINA.items() if k not in ("density", "young_modulus")}
    thick = {**keys, "mass_per_length": "214.4 g/m", "bending_stiffness": "1.51 N m2"}
    other = preset("paper").lamina[1].model_dump()
    lamina = preset("paper", {"lamina": [thick, other]}).lamina[0]
    assert lamina.density == pytest.approx(2680.0, rel=1e-12)
    assert lamina.young_modulus == pytest.approx(12.0 * 1.51 / (0.04 * 0.002**3), rel=1e-12)


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("lamina.thick.thickness", "2 kg", r"lamina\.thick\.thickness: "),
        ("lamina.thick.young_modulus", "70 GPx", "expected a modulus such as .*: unknown unit"),
        ("gap.tip", "12 mm/s", r"case paper: gap\.tip: expected a length .* given '12 mm/s'$"),
        ("gap.tip", "-12 mm", r"gap\.tip: .*given -0\.012"),
        ("excitation.frequency", "195 rpm", "expected a frequency .* not an angular one"),
        ("excitation.frequency", "20 rad/s", "expected a frequency .* not an angular one"),
        ("excitation.amplitude", "2 g", r"excitation\.amplitude: "),
        ("time.periods", "3 s", r"time\.periods: "),
    ],
)
def test_a_wrong_unit_is_told_in_one_line(key: str, value: str, expected: str) -> None:
    with pytest.raises(CaseError, match=expected) as told:
        preset("paper", {key: value})
    assert "\n" not in str(told.value)


def test_the_unit_of_noise_is_that_of_the_sensor() -> None:
    keys = {"name": "s", "quantity": "velocity", "lamina": "thin", "position": "0.5 m"}
    assert preset("paper", {"sensor": [{**keys, "noise": "1 mm/s"}]}).sensor[0].noise == 0.001
    with pytest.raises(CaseError, match=r"sensor\.s\.noise: "):
        preset("paper", {"sensor": [{**keys, "noise": "1 mm"}]})


def notes_of(annotation: Any) -> list[Any]:
    """Return the notes of an annotated type and of its parts."""
    notes = list(getattr(annotation, "__metadata__", ()))
    for part in getattr(annotation, "__args__", ()):
        notes += notes_of(part)
    return notes


def test_units_are_those_of_the_documents() -> None:
    """The unit in a docstring, which documents show, is the one that texts are converted to."""
    n_units = 0
    for table in tables():
        for key in table.keys:
            field = table.model.model_fields.get(key.name)
            notes = [] if field is None else [*field.metadata, *notes_of(field.annotation)]
            units = [note.name for note in notes if isinstance(note, Unit)]
            if units:
                assert key.unit.split(" per node")[0].replace("-", "1") == units[0], key.name
                n_units += 1
            elif field is not None and key.unit not in ("", "-"):
                pytest.fail(f"{table.heading} {key.name} [{key.unit}] takes no units")
    assert n_units > 40
    assert SENSOR_UNITS["contact force"] == "N"


def test_pint_is_imported_only_for_a_unit() -> None:
    code = (
        "import sys; from delam_fem.case.files import preset; preset('paper');"
        "assert 'pint' not in sys.modules; preset('paper', {'gap.tip': '12 mm'});"
        "assert 'pint' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
