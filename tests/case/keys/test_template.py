"""Commented case files load, run the case of their preset, and have every key."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from delam_fem.api import Case, load_case, preset, tables
from delam_fem.case.keys import KINDS, WIDTH, KindName, case_text

PRESETS = {"apart": "default", "paper": "paper", "layered": "embedded", "edge": "edge"}


@pytest.mark.parametrize("kind", KINDS)
def test_a_commented_file_is_the_case_of_its_preset(kind: KindName, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(case_text(kind, "mine"), encoding="utf-8")
    strips = preset(PRESETS[kind], {"name": "mine"})
    if kind == "apart":  # own strips: of a material
        materials = {f"lamina.{lamina.name}.material": "aluminium" for lamina in strips.lamina}
        strips = strips.with_overrides(materials)
    assert load_case(path) == strips


def test_the_geometry_of_own_strips_counts() -> None:
    """EI of the template is E b h^3/12, so that a narrower strip has less of it."""
    text = case_text("apart", "mine").replace("width = 0.04 ", "width = 0.025", 1)
    thick = Case.from_toml(text).lamina[0]
    EI = 70e9 * 0.025 * 0.002**3 / 12.0
    assert thick.flexural_rigidity == pytest.approx(EI, rel=1e-12)
    first = thick.angular_frequencies(1)[0]
    assert first == pytest.approx((1.8751040687 / 0.685) ** 2 * np.sqrt(EI / (2700.0 * 5e-5)))


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_stands_in_the_file(kind: KindName) -> None:
    text = case_text(kind, "mine")
    _, first, *others = text.split("\n\n")
    blocks = [first, *(block for block in others if block.startswith("#"))]
    for table, block in zip(tables(), blocks, strict=True):
        assert " ".join(table.meaning.split()[:4]) in block or not table.name
        for key in table.keys:
            assert re.search(rf"^(# )?{key.name} =", block, re.MULTILINE), (table.heading, key.name)
    assert max(map(len, text.splitlines())) <= WIDTH


def test_a_default_that_is_uncommented_changes_nothing() -> None:
    """What the comments give as defaults are those of the models."""
    text = case_text("paper", "mine")
    first, last = text.index("[contact]"), text.index("# [[point_mass]]")  # what follows is absent
    active = text[first:last]
    switched, count = re.subn(r"^# (\w+ = \S)", r"\1", active, flags=re.MULTILINE)
    assert count >= 3  # penalty_damping, points_per_element, refine, …
    case = Case.checked(tomllib.loads(text[:first] + switched), "mine")
    assert case == preset("paper", {"name": "mine"})


def test_comments_tell_unit_default_and_need() -> None:
    text = " ".join(case_text("paper", "mine").replace("#", " ").split())
    assert "thickness h [m] (a positive number or a table over x; required)" in text
    assert "contact spring [N/m per node pair] (a number of at least 0; default 100.0)" in text
    assert "density rho [kg/m3]; a material or mass_per_length gives it too (a positive" in text
    assert 'kind = "harmonic" "harmonic" (required)' in text
