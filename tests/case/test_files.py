"""Cases: presets, files, overrides, messages, round trips."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from pydantic import ValidationError

from delam_fem.api import (
    PRESETS,
    Case,
    CaseError,
    InitialGap,
    Lamina,
    load_case,
    preset,
    save_case,
    toml_text,
)
from delam_fem.case.files import preset_text
from delam_fem.case.toml import parse_override

ROUND_OFF = 1e-14
"""A few operations on doubles."""

SWEEP = {
    "excitation.kind": "sweep",
    "excitation.start_frequency": 4.0,
    "excitation.end_frequency": 0.5,
    "excitation.duration": 10.0,
}


def refused(overrides: dict[str, object]) -> str:
    """Return the message with which the preset `paper` refuses overrides."""
    with pytest.raises(CaseError) as error:
        preset("paper", overrides)
    return str(error.value)


def test_preset_paper_has_the_values_of_the_paper() -> None:
    case = preset("paper")
    thick, thin = case.lamina
    assert (thick.name, thin.name) == ("thick", "thin")
    assert (thick.flexural_rigidity, thin.flexural_rigidity) == (1.51, 0.16)
    assert thick.mass_per_length / thin.mass_per_length == pytest.approx(1.942, abs=5e-4)
    assert (case.gap.tip, case.gap.exponent, case.mesh.elements) == (0.012, 2.0, 20)
    assert (case.contact.law, case.contact.impulse) == ("newton-penalty", "lumped")
    assert (case.contact.restitution, case.contact.penalty_stiffness) == (0.1, 100.0)
    assert (case.contact.threshold_velocity, thick.damping_ratio) == (0.5e-3, 0.008)
    assert (case.time.steps_per_period, case.time.periods) == (1000, 300)
    assert (case.damping.rayleigh, case.time.mass) == ("two-mode", "consistent")


def test_natural_frequencies_are_those_of_the_specified_stiffness() -> None:
    f1 = [lamina.angular_frequencies(1)[0] / (2 * math.pi) for lamina in preset("paper").lamina]
    assert f1 == pytest.approx([3.1649, 1.4357], abs=5e-5)


def test_rigidity_follows_from_the_modulus_where_no_stiffness_is_given() -> None:
    thick = preset("paper", {"lamina.thick.bending_stiffness": None}).lamina[0]
    assert thick.flexural_rigidity == pytest.approx(5.85e10 * 0.04 * 0.002**3 / 12, rel=ROUND_OFF)


@pytest.mark.parametrize(
    ("model", "modes"), [("two-mode", (0, 1)), ("stiffness", (0,)), ("mass", (0,))]
)
@pytest.mark.parametrize("i", [0, 1])
def test_rayleigh_damping_has_the_ratio_at_its_modes(
    model: str, modes: tuple[int, ...], i: int
) -> None:
    case = preset("paper", {"damping.rayleigh": model})
    alpha, beta = case.rayleigh(i)
    omega = case.lamina[i].angular_frequencies(2)
    ratios = 0.5 * (alpha / omega + beta * omega)
    assert ratios[list(modes)] == pytest.approx(0.008, rel=ROUND_OFF)
    assert (alpha > 0.0, beta > 0.0) == (model != "stiffness", model != "mass")


def test_times_of_a_harmonic_run() -> None:
    case = preset("paper", {"time.periods": 3})
    assert case.time_step == pytest.approx(1 / 3250, rel=ROUND_OFF)
    assert case.period == pytest.approx(1 / 3.25, rel=ROUND_OFF)
    assert (case.n_periods, case.n_window_periods) == (3, 3)


def test_times_of_a_sweep_follow_its_highest_frequency() -> None:
    case = preset("paper", SWEEP)
    assert case.time_step == pytest.approx(1 / 4000, rel=ROUND_OFF)
    assert (case.n_periods, case.n_window_periods) == (40, 40)
    assert preset("paper", {**SWEEP, "excitation.duration": 10.1}).n_periods == 41


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("lamina.thick.length", -0.685, "lamina.thick.length: "),
        ("lamina.2.density", True, "lamina.thin.density: .*given True"),
        ("lamina.thin.width", "0.04", "lamina.thin.width: "),
        ("lamina.thin.damping_ratio", 1, "expected a number from 0 to below 1, given 1"),
        ("contact.restitution", 1.5, "contact.restitution: "),
        ("contact.restitutoin", 0.1, "contact.restitutoin: unknown key; did you mean restitution?"),
        ("contact.law", "nwton", "contact.law: .*given 'nwton'"),
        ("mesh.elements", 0, "mesh.elements: "),
        ("mesh.elements", 20.0, "mesh.elements: .*given 20.0"),
        ("time.steps_per_period", 0, "time.steps_per_period: "),
        ("time.periods", 0, 'expected a whole number of at least 1, or "settled", given 0'),
        ("time.periods", "setled", "time.periods: .*given 'setled'"),
        ("time.most_periods", 0, "time.most_periods: "),
        ("output.fields_per_period", 1001, "expected at most time.steps_per_period = 1000"),
        ("excitation.frequency", math.nan, "frequency: .*given nan"),
        ("excitation.frequency", math.inf, "frequency: .*given inf"),
        ("excitation.amplitude", -1.0, "amplitude: .*given -1.0"),
        ("excitation.kind", "swep", "excitation.kind: .*given 'swep'"),
        ("excitation.frequency.x", 1, "excitation.frequency is not a table"),
        ("excitation", 1, "excitation: "),
        ("excitation", {"frequency": 1.0}, "excitation.kind: missing, but required"),
        ("lamina.length", 1.0, "expected lamina.thick.length or lamina.thin.length"),
        ("lamina.3.length", 1.0, "no entry '3'; expected one of thick, thin"),
        ("lamina.thin.name", "thick", "expected two names, given 'thick' twice"),
        ("lamina", [], "lamina: .*given none"),
        ("name", "../up", "name: "),
        ("gap.tip", 0.0, "gap.tip: .*given 0.0"),
        ("gap.tip", None, "gap.tip: missing, but required"),
        ("gap.file", "none.csv", "gap.file: no such file: /.*none.csv"),
        ("mesh.file", "none.msh", "mesh.file: no such file: /.*none.msh"),
        ("mesh.elements", None, "mesh: .*given none"),
        ("frequency", 2.0, "frequency: unknown key; expected one of name, lamina, gap"),
        ("excitation.", 2.0, "not a key of a case"),
    ],
)
def test_bad_value_is_told_with_its_key(key: str, value: object, expected: str) -> None:
    with pytest.raises(CaseError, match=expected):
        preset("paper", {key: value})


def test_combinations_that_contradict_each_other() -> None:
    assert "gap: expected one of exponent, shape, file, given exponent and shape" in refused(
        {"gap.exponent": 2.0, "gap.shape": "mode"}
    )
    assert 'contact.law: the law "penalty" goes with the scheme "newmark"' in refused(
        {"contact.law": "penalty", "time.scheme": "moreau-jean"}
    )


def test_all_problems_are_listed_and_nothing_of_pydantic() -> None:
    text = refused({"contact.restitution": 2, "mesh.elements": -1})
    assert text.splitlines() == [
        "case paper: 2 problems",
        "  mesh.elements: expected a whole number from 1 to 100000, given -1",
        "  contact.restitution: expected a number from 0 to 1, given 2",
    ]


def test_a_sweep_asks_for_its_own_keys() -> None:
    text = refused({"excitation.kind": "sweep"})
    for key in ("start_frequency", "end_frequency", "duration"):
        assert f"excitation.{key}: missing, but required" in text


def test_unknown_preset() -> None:
    with pytest.raises(CaseError, match="preset 'pape': unknown; expected one of paper, default"):
        preset("pape")


def test_overrides_replace_alternatives(tmp_path: Path) -> None:
    table = tmp_path / "gap.csv"
    table.write_text("0, 0\n0.685, 0.012\n")
    case = preset("paper", {"gap.shape": "mode", "mesh.elements": np.int64(5)})
    assert (case.gap.shape, case.gap.exponent, case.mesh.elements) == ("mode", None, 5)
    case = case.with_overrides({"gap.file": str(table)})
    assert case.gap == InitialGap(file=table)
    assert case.with_overrides({"gap.exponent": 3.0, "gap.tip": 0.01}).gap.exponent == 3.0
    assert case.with_overrides(SWEEP).excitation.amplitude == 0.0025


def test_overrides_leave_the_original_alone_and_cases_are_frozen() -> None:
    case = preset("paper")
    assert case.with_overrides({"lamina.1.thickness": 0.003}).lamina[0].thickness == 0.003
    assert case == preset("paper")
    with pytest.raises(ValidationError, match="frozen"):
        case.lamina[0].length = 1.0


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a.b=3", 3),
        ("a.b = 3.5e-1", 0.35),
        ("a.b=newton-penalty", "newton-penalty"),
        ('a.b="newton"', "newton"),
        ("a.b=gaps/a=b.csv", "gaps/a=b.csv"),
        ("a.b=2020-01-01", "2020-01-01"),
        ("a.b=", None),
    ],
)
def test_override_of_the_command_line(text: str, value: object) -> None:
    assert parse_override(text) == ("a.b", value)


@pytest.mark.parametrize("text", ["a.b", "=3"])
def test_override_without_key_or_value(text: str) -> None:
    with pytest.raises(CaseError, match="expected KEY=VALUE"):
        parse_override(text)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_round_trip(name: str) -> None:
    case = preset(name)
    assert case.name == name
    assert Case.from_toml(case.to_toml()) == case


numbers = st.floats(min_value=1e-30, max_value=1e30)
names = st.from_regex(r"[A-Za-z][A-Za-z0-9_-]{0,10}", fullmatch=True)
laminae = st.builds(
    Lamina,
    name=names,
    length=st.just(0.3),
    width=numbers,
    thickness=numbers,
    density=numbers,
    young_modulus=numbers,
    bending_stiffness=st.none() | numbers,
    damping_ratio=st.floats(0.0, 1.0, exclude_max=True),
)


@given(
    pair=st.tuples(laminae, laminae).filter(lambda pair: pair[0].name != pair[1].name),
    gap=st.builds(InitialGap, tip=numbers, exponent=numbers),
    restitution=st.floats(0.0, 1.0),
    elements=st.integers(1, 100_000),
)
@settings(max_examples=50, derandomize=True, deadline=None)
def test_round_trip_is_exact(
    pair: tuple[Lamina, Lamina], gap: InitialGap, restitution: float, elements: int
) -> None:
    case = preset(
        "paper", {"contact.restitution": restitution, "mesh.elements": elements}
    ).model_copy(update={"lamina": pair, "gap": gap})
    assert Case.from_toml(case.to_toml()) == case


@given(st.text(st.characters(exclude_categories=["Cs"])))
@settings(derandomize=True)
def test_any_text_survives_toml(text: str) -> None:
    assert tomllib.loads(toml_text({"text": text})) == {"text": text}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a = " + "[" * 5000, "expected at most 16 levels"),
        ("a = " + "[" * 50 + "]" * 50, "expected at most 16 levels"),
        (".".join("a" * 5000) + " = 1", "expected at most 16 levels"),
        ("[" + ".".join("a" * 40) + "]", "expected at most 16 levels"),
        ("a = " + "1" * 5000, "whole numbers of at most 64 bits"),
        ("a = 0x" + "f" * 5000, "whole numbers of at most 64 bits"),
        ("a = [[9223372036854775808]]", "whole numbers of at most 64 bits"),
    ],
)
def test_depth_and_digits_are_limited(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "case.toml"
    path.write_text(text)
    with pytest.raises(CaseError, match=expected):
        load_case(path)
    with pytest.raises(CaseError, match=r"expected at most 16|of at most 64 bits|KEY=VALUE"):
        parse_override(text.replace("a = ", "mesh.elements = ", 1).replace("[a", "a", 1))


@pytest.mark.parametrize(("encoding", "newline"), [("utf-8-sig", "\n"), ("utf-8", "\r\n")])
def test_byte_order_mark_and_line_ends_of_other_systems(
    tmp_path: Path, encoding: str, newline: str
) -> None:
    path = tmp_path / "case.toml"
    path.write_text(preset_text("paper"), encoding, newline=newline)
    assert load_case(path) == preset("paper")


@pytest.mark.parametrize("name", ["a" * 5000, "a\0b", "/".join(["a" * 200] * 9)])
def test_impossible_file_names(name: str) -> None:
    with pytest.raises(CaseError, match=r"gap\.file: "):
        preset("paper", {"gap.file": name})


def test_missing_file_and_broken_toml(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    with pytest.raises(CaseError, match=r"case file .*case\.toml: no such file"):
        load_case(path)
    path.write_text('name = "x"\nlength = = 3\n')
    with pytest.raises(CaseError, match=r"case\.toml: not valid TOML: .*line 2"):
        load_case(path)
    path.write_bytes(b"name = '\xff'")
    with pytest.raises(CaseError, match="expected UTF-8 text"):
        load_case(path)
    with pytest.raises(CaseError, match=r"expected a file, given a folder"):
        load_case(tmp_path)
    path.write_text("")
    with pytest.raises(CaseError, match="lamina: missing, but required"):
        load_case(path)
    with pytest.raises(CaseError, match="case: not valid TOML"):
        Case.from_toml("=")


def test_files_are_seen_from_the_case_file_or_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "case").mkdir()
    for folder in (tmp_path, tmp_path / "case"):
        (folder / "gap.csv").write_text("0,0\n0.685,0.012\n")
    monkeypatch.chdir(tmp_path)
    text = preset("paper").to_toml().replace("tip = 0.012\nexponent = 2.0", 'file = "gap.csv"')
    (tmp_path / "case" / "case.toml").write_text(text)
    case = load_case("case/case.toml")
    assert case.gap.file == tmp_path / "case" / "gap.csv"
    assert load_case("case/case.toml", {"gap.file": "gap.csv"}).gap.file == tmp_path / "gap.csv"
    assert preset("paper", {"gap.file": "gap.csv"}).gap.file == tmp_path / "gap.csv"


def test_saved_case_takes_its_files_along(tmp_path: Path) -> None:
    for name, content in (("a/data.csv", "0,0\n0.685,0.012\n"), ("b/data.csv", "mesh")):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(content)
    mesh, gap = tmp_path / "b/data.csv", tmp_path / "a/data.csv"
    case = preset("paper", {"gap.file": str(gap), "mesh.file": str(mesh)})
    saved = save_case(case, tmp_path / "run")
    assert saved == tmp_path / "run" / "case.toml"
    (tmp_path / "run").rename(tmp_path / "moved")
    gap.unlink()
    mesh.unlink()
    again = load_case(tmp_path / "moved" / "case.toml")
    assert again.gap.file == tmp_path / "moved" / "data.csv"
    assert again.mesh.file == tmp_path / "moved" / "mesh-data.csv"
    assert again.mesh.file.read_text() == "mesh"
    save_case(again, tmp_path / "moved")  # onto itself
    assert load_case(tmp_path / "moved" / "case.toml") == again
    assert not list((tmp_path / "moved").glob(".delam_fem-*"))


def test_saved_xdmf_mesh_keeps_its_numbers(tmp_path: Path) -> None:
    for name in ("m.xdmf", "m.h5"):
        (tmp_path / name).write_text(name)
    save_case(preset("paper", {"mesh.file": str(tmp_path / "m.xdmf")}), tmp_path / "run")
    assert (tmp_path / "run" / "m.h5").read_text() == "m.h5"


def test_a_law_may_be_set_with_its_scheme() -> None:
    case = preset("paper", {"contact.law": "newton@moreau-jean"})
    assert (case.contact.law, case.time.scheme) == ("newton", "moreau-jean")
    with pytest.raises(CaseError, match=r"time\.scheme: "):
        preset("paper", {"contact.law": "newton@euler"})
    tables = case.model_dump(exclude_unset=True)
    tables["contact"]["law"] = "newton@moreau-jean"
    assert Case(**tables) == case
    with pytest.raises(CaseError, match=r"contact\.law: "):
        Case(**(tables | {"time": {"scheme": "newmark"}}))
    del tables["time"]
    assert Case(**tables).time.scheme == "moreau-jean"


@pytest.mark.parametrize("name", ["paper", "default"])
def test_presets_have_only_keys_that_are_read(name: str) -> None:
    assert preset(name).unread == ()


def test_a_modulus_that_disagrees_with_ei_is_named() -> None:
    """EI = E b h^3/12 of 70 GPa is 1.867 N m2; the lamina has 1.51 N m2."""
    case = preset("paper", {"lamina.thick.young_modulus": 70e9})
    assert case.lamina[0].flexural_rigidity == 1.51
    assert case.unread == ("lamina.thick.young_modulus",)
    assert case.with_overrides({"lamina.thick.bending_stiffness": None}).unread == ()


def test_keys_that_nothing_reads_are_named_not_refused() -> None:
    case = preset("paper", {"contact.law": "newton"})
    assert case.unread == ("contact.penalty_stiffness", "contact.threshold_velocity")
    again = Case.from_toml(case.to_toml())
    assert again == case
    assert again.unread == case.unread
    swept = {"excitation.kind": "sweep", "excitation.start_frequency": 1.0}
    swept |= {"excitation.end_frequency": 2.0, "excitation.duration": 3.0}
    assert preset("paper", swept).unread == ("time.periods",)


def test_keys_that_were_not_given_are_never_named() -> None:
    text = preset("default").to_toml()
    case = Case.from_toml(text).with_overrides({"contact.law": "none"})
    of_contact = ("contact.restitution", "contact.threshold_velocity")
    assert case.unread == (*of_contact, "time.refine", "time.refine_velocity")
    assert "penalty_stiffness" not in text
