"""Layered beams in the case file: materials, supports, delaminations, openings."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from delam_fem.api import Case, CaseError, assemble, load_case, preset, save_case
from delam_fem.case.files import preset_text
from delam_fem.case.gap import opening_at_rest
from delam_fem.case.materials import MATERIALS
from delam_fem.case.sections import Delamination

EDGES = {"between": ("lower", "upper"), "start": 0.1, "end": 0.3}


def refused(overrides: dict[str, object], name: str = "embedded") -> str:
    """Return the message with which a preset refuses overrides."""
    with pytest.raises(CaseError) as error:
        preset(name, overrides)
    return str(error.value)


def written(case: Case) -> Case:
    """Return a case after it went through its text."""
    return Case.from_toml(case.to_toml())


def test_preset_embedded_is_the_aluminium_beam() -> None:
    case = preset("embedded")
    lower, upper = case.lamina
    assert (lower.density, lower.young_modulus) == (2700.0, 70e9)
    assert (lower.thickness, upper.thickness, case.length) == (0.0014, 0.0006, 0.4)
    assert (case.support.start, case.support.end, case.is_apart) == ("clamped", "clamped", False)
    (delamination,) = case.delamination
    assert (delamination.start, delamination.end, delamination.opening) == (0.12, 0.28, 0.0)
    assert written(case) == case


def test_a_material_gives_density_and_modulus() -> None:
    case = preset("embedded", {"lamina.upper.material": "steel"})
    assert case.lamina[1].density == MATERIALS["steel"]["density"]
    assert case.lamina[1].young_modulus == MATERIALS["steel"]["young_modulus"]
    again = case.with_overrides({"lamina.upper.material": "titanium"})
    assert again.lamina[1].young_modulus == MATERIALS["titanium"]["young_modulus"]


def test_a_number_replaces_that_of_the_material_and_keeps_the_other() -> None:
    upper = preset("embedded", {"lamina.upper.density": 2600.0}).lamina[1]
    assert (upper.density, upper.young_modulus, upper.material) == (2600.0, 70e9, None)


def test_stiffness_and_mass_per_length_are_enough() -> None:
    lamina = {
        "name": "upper",
        "length": 0.4,
        "width": 0.02,
        "thickness": 0.0006,
        "damping_ratio": 0.005,
        "bending_stiffness": 0.03,
        "mass_per_length": 0.04,
    }
    lower = preset("embedded").lamina[0].model_dump(exclude_none=True)
    upper = preset("embedded", {"lamina": [lower, lamina]}).lamina[1]
    assert upper.flexural_rigidity == 0.03
    assert upper.mass_per_length == pytest.approx(0.04, rel=1e-15)
    assert upper.axial_rigidity == pytest.approx(12.0 * 0.03 / 0.0006**2, rel=1e-14)


@pytest.mark.parametrize(
    ("overrides", "text"),
    [
        ({"lamina.upper.material": "cheese"}, "lamina.upper.material: "),
        ({"lamina.upper.mass_per_length": -1.0}, "upper.mass_per_length: "),
        ({"support.start": "glued"}, "support.start: "),
        ({"delamination.1.start": 0.3}, "delamination.1.end: "),
        ({"delamination.1.end": 0.5}, "delamination.1.end: "),
        ({"delamination.1.between": ["upper", "lower"]}, 'expected neighbours .* \\["lower", "up'),
        ({"delamination.1.between": ["lower"]}, "delamination.1.between: "),
        ({"delamination.1.opening": -1.0}, "opening: .*given -1.0"),
        ({"delamination.1.shape": "power"}, "delamination.1.shape: "),
        ({"delamination.1.exponent": 2.0}, "exponent: "),
        ({"delamination.1.file": "no.csv"}, "delamination.1.file: no such file: /.*no.csv"),
        ({"delamination.2.start": 0.1}, "no entry '2'; expected one of lower-upper or a n"),
        ({"gap.tip": 0.01}, "gap: "),
        ({"delamination.1.star": 0.1}, "delamination.1.star: unknown key; did you mean start?"),
    ],
)
def test_bad_layers_are_told_with_their_key(overrides: dict[str, object], text: str) -> None:
    with pytest.raises(CaseError, match=text):
        preset("embedded", overrides)


def test_delaminations_between_the_same_laminae_are_apart() -> None:
    two = [EDGES, {**EDGES, "start": 0.3, "end": 0.35}]
    assert "delamination.2.start: expected a place apart from delamination.1" in refused(
        {"delamination": two}
    )


def test_only_clamped_ends_of_beams_yield() -> None:
    soft = {"support.rotational_stiffness": "150 N m"}
    assert preset("embedded", soft).support.rotational_stiffness == 150.0
    expected = (
        'support.rotational_stiffness: expected only with a clamped end and model.kind = "beam"'
    )
    for keys in ({"support.start": "pinned", "support.end": "pinned"}, {"model.kind": "solid"}):
        assert expected in refused(soft | keys, "embedded")


def test_laminae_beside_a_gap_take_other_supports_and_stay_apart() -> None:
    case = preset("paper", {"support.end": "clamped", "support.rotational_stiffness": "150 N m"})
    assert case.is_apart
    assert not case.has_exact_laminae
    assert case.support.holds("end") and case.support.turns("end")
    assert preset("paper").has_exact_laminae


def test_laminae_without_gap_and_delaminations_are_bonded_only_if_that_is_said() -> None:
    assert "gap: missing, but required for laminae that are apart" in refused(
        {"gap": None}, "paper"
    )
    assert not preset("paper", {"gap": None, "support.end": "free"}).is_apart


def test_three_laminae_with_a_gap_are_apart() -> None:
    thick, thin = (lamina.model_dump(exclude_none=True) for lamina in preset("paper").lamina)
    case = preset("paper", {"lamina": [thick, thin, {**thin, "name": "top"}]})
    assert case.is_apart
    structure = assemble(case, needs_dolfinx=False)
    assert [interface.places.size for interface in structure.layout.interfaces] == [20, 20]


def test_openings_at_rest() -> None:
    x = np.array([0.1, 0.15, 0.2, 0.3])
    arch = Delamination(**EDGES, opening=0.002)
    expected = 0.002 * np.cos(np.pi * np.array([-0.5, -0.25, 0.0, 0.5]))
    assert opening_at_rest(arch, x, 0.4) == pytest.approx(expected, abs=1e-18)
    power = Delamination(**EDGES, opening=0.002, shape="power", exponent=3.0)
    s = (x - 0.1) / 0.2
    assert opening_at_rest(power, x, 0.4) == pytest.approx(0.002 * s**3)
    from_start = opening_at_rest(power, x, 0.4, opens_at_start=True)
    assert from_start == pytest.approx(0.002 * (1.0 - s) ** 3)


@pytest.mark.parametrize("free", ["start", "end"])
def test_a_power_opens_towards_the_free_end(free: str) -> None:
    edges = {"start": 0.0, "end": 0.2} if free == "start" else {"start": 0.2, "end": 0.4}
    case = preset(
        "embedded",
        {
            f"support.{free}": "free",
            **{f"delamination.1.{key}": value for key, value in edges.items()},
            "delamination.1.opening": 0.001,
            "delamination.1.shape": "power",
            "delamination.1.exponent": 1.0,
        },
    )
    structure = assemble(case, needs_dolfinx=False)
    (interface,) = structure.layout.interfaces
    x = structure.layout.parts[0].positions(interface.places)
    distance = x - 0.2 if free == "end" else 0.2 - x
    assert structure.operators.gap0 == pytest.approx(0.001 * distance / 0.2, abs=1e-17)
    assert distance.max() == pytest.approx(0.2)  # the free end is a pair


def test_a_measured_opening_travels_with_the_case(tmp_path: Path) -> None:
    (tmp_path / "blister.csv").write_text("x,gap\n0.12,0.0\n0.2,0.0003\n0.28,0.0\n")
    text = preset_text("embedded").replace("opening = 0.0 ", 'file = "blister.csv" ')
    (tmp_path / "case.toml").write_text(text)
    case = load_case(tmp_path / "case.toml")
    gap0 = assemble(case, needs_dolfinx=False).operators.gap0
    assert gap0.max() == pytest.approx(0.0003)
    saved = load_case(save_case(case, tmp_path / "kept"))
    assert (tmp_path / "kept" / "blister.csv").is_file()
    assert assemble(saved, needs_dolfinx=False).operators.gap0.tolist() == gap0.tolist()


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        ("0.13,0\n0.28,0\n", "expected x from 0.12 to 0.28 m, given 0.13 to 0.28"),
        ("0.1,0\n0.2,-1e-4\n0.3,0\n", "line 2: .*given -0.0001 m"),
    ],
)
def test_bad_tables_are_told(tmp_path: Path, rows: str, text: str) -> None:
    (tmp_path / "t.csv").write_text(rows)
    case = preset(
        "embedded",
        {"delamination.1.file": str(tmp_path / "t.csv"), "delamination.1.opening": None},
    )
    with pytest.raises(CaseError, match=text):
        assemble(case, needs_dolfinx=False)


def both(**numbers: object) -> Case:
    """Return the preset "embedded" with an upper lamina of steel that has numbers beside it."""
    upper = {"name": "upper", "length": 0.4, "width": 0.02, "thickness": 0.0006,
             "material": "steel", "damping_ratio": 0.005}  # fmt: skip
    lower = {**upper, "name": "lower", "thickness": 0.0014}
    return preset("embedded", {"lamina": [lower, {**upper, **numbers}]})


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [("density", 7800.0, "7850"), ("young_modulus", "200 GPa", r"2\.1e\+11")],
)
def test_a_number_unlike_that_of_the_material_is_refused(
    key: str, value: object, said: str
) -> None:
    number_text = "7800" if key == "density" else r"2e\+11"
    with pytest.raises(CaseError, match=rf"lamina\.upper\.{key}: .*{said}.*steel.*{number_text}"):
        both(**{key: value})


def test_a_written_case_says_the_material_and_not_its_numbers() -> None:
    for case in (both(), both(density=7850.0, young_modulus="210 GPa")):
        upper = tomllib.loads(case.to_toml())["lamina"][1]
        assert upper["material"] == "steel"
        assert not {"density", "young_modulus"} & set(upper)
        assert Case.from_toml(case.to_toml()) == case


def test_another_material_in_a_written_case_counts() -> None:
    text = both().to_toml().replace('"steel"', '"titanium"')
    upper = Case.from_toml(text).lamina[1]
    assert (upper.young_modulus, upper.density) == (113.8e9, 4430.0)


def test_a_written_case_says_the_numbers_where_they_were_given() -> None:
    case = preset("embedded", {"lamina.upper.density": 2600.0})
    upper = tomllib.loads(case.to_toml())["lamina"][1]
    assert (upper["density"], upper["young_modulus"]) == (2600.0, 70e9)
    assert "material" not in upper


def test_a_modulus_that_follows_from_the_bending_stiffness_is_not_written() -> None:
    case = preset("paper", {"lamina.thick.young_modulus": None})
    assert "young_modulus" not in tomllib.loads(case.to_toml())["lamina"][0]
    narrow = case.with_overrides({"lamina.thick.width": 0.02})
    # E = 12 EI / (b h^3) of the new width
    assert narrow.lamina[0].young_modulus == pytest.approx(12.0 * 1.51 / (0.02 * 0.002**3))
    assert Case.from_toml(case.to_toml()) == case


def test_a_mass_per_length_is_written_as_such_and_keeps_its_last_digit() -> None:
    """0.2144 / (b h) * (b h) is another double than 0.2144; also beside a material."""
    upper = {"name": "upper", "length": 0.4, "width": 0.03, "thickness": 0.0007,
             "material": "steel", "damping_ratio": 0.005, "mass_per_length": 0.2144}  # fmt: skip
    lower = {**upper, "name": "lower"}
    case = preset("embedded", {"lamina": [lower, upper]})
    written_upper = tomllib.loads(case.to_toml())["lamina"][1]
    assert written_upper["mass_per_length"] == 0.2144 == case.lamina[1].mass_per_length
    assert not {"density", "young_modulus"} & set(written_upper)
    assert Case.from_toml(case.to_toml()) == case
    wide = case.with_overrides({"lamina.upper.width": 0.06}).lamina[1]
    assert wide.density == pytest.approx(0.2144 / (0.06 * 0.0007))
    heavy = case.with_overrides({"lamina.upper.density": 5000.0}).lamina[1]
    assert heavy.mass_per_length == pytest.approx(5000.0 * 0.03 * 0.0007)


def test_a_point_is_written_without_its_picture() -> None:
    ball = {"name": "ball", "mass": 0.3, "stiffness": 120.0, "damping_ratio": 0.01}
    case = preset("default", {"lamina": [ball], "gap": None, "mesh.elements": 1})
    assert tomllib.loads(case.to_toml())["lamina"] == [ball]
    assert Case.from_toml(case.to_toml()) == case


def test_support_in_one_and_in_two_brackets_is_explained(tmp_path: Path) -> None:
    file = tmp_path / "both.toml"
    text = preset_text("embedded").replace("[[delamination]]", "[[support]]\nposition = 0.05\n"
                                           'kind = "pinned"\n\n[[delamination]]', 1)  # fmt: skip
    for way in (text, text.replace("[support]", "[[support]]", 1)):
        file.write_text(way, encoding="utf-8")
        if way is not text:
            assert load_case(file).support.inside[0].position == 0.05
            continue
        with pytest.raises(CaseError, match=r"\[support\] and \[\[support\]\].*\[\[support\]\]"):
            load_case(file)


@pytest.mark.parametrize("key", ["placed", "beginning"])
def test_keys_that_supports_do_not_have_are_refused_without_words_of_the_program(key: str) -> None:
    for tables in ({key: 3}, [{key: 3}, {"position": 0.1, "kind": "pinned"}]):
        message = refused({"support": tables})
        assert f"support.{key}" in message
        assert "start, end, rotational_stiffness" in message
        assert "placed" not in message.replace(f"support.{key}", "")
