"""What `check` shows of a case: the numbers of its law, and all that acts on its laminae."""

from __future__ import annotations

from pathlib import Path

import pytest
from support import invoke

CASE = """name = "full"
[[lamina]]
name = "beam"
length = 0.3
width = 0.02
thickness = 0.002
material = "steel"
damping_ratio = 0.01
[[support]]
start = "clamped"
end = "pinned"
[[support]]
position = 0.11
kind = "spring"
stiffness = 1234.0
[mesh]
elements = 12
[excitation]
kind = "harmonic"
frequency = 30.0
acceleration = 5.0
[contact]
law = "penalty"
[time]
periods = 20
[[stop]]
lamina = "beam"
side = "above"
gap = 0.0017
position = 0.21
stiffness = 1e5
[[impactor]]
lamina = "beam"
mass = 0.013
velocity = 0.57
radius = 0.005
position = 0.25
[[initial]]
shape = "mode"
mode = 3
velocity = 0.37
[[point_mass]]
lamina = "beam"
mass = 0.019
position = 0.15
[[sensor]]
name = "mid"
lamina = "beam"
position = 0.16
quantity = "velocity"
sampling_rate = "10 kHz"
"""

POINT = """name = "point"
[[lamina]]
name = "beam"
mass = 1.25
stiffness = 300.0
damping_ratio = 0.01
[mesh]
elements = 1
[excitation]
kind = "harmonic"
frequency = 3.0
acceleration = 0.1
[contact]
law = "none"
"""


def rows(output: str) -> dict[str, str]:
    """Return the rows of the table by their headings; lines that go on are joined."""
    texts: dict[str, str] = {}
    heading = ""
    for line in output.splitlines():
        cells = [cell.strip() for cell in line.split("│")[1:-1]]
        if len(cells) == 2:
            heading = cells[0] or heading
            texts[heading] = f"{texts.get(heading, '')} {cells[1]}".strip()
    return texts


def test_all_that_acts_on_laminae_is_shown(tmp_path: Path) -> None:
    file = tmp_path / "full.toml"
    file.write_text(CASE, encoding="utf-8")
    result = invoke("check", file)
    assert result.exit_code == 0, result.stderr
    table = rows(result.stdout)
    expected = {
        "lamina beam": ["steel"], "support 1": ["0.11", "1234"], "point mass 1": ["0.019", "0.15"],
        "stop 1": ["0.21", "1.7 mm", "100000 N/m"],
        "impactor 1": ["0.013 kg", "0.25", "0.57 m/s", "5 mm", "210 GPa", "0.3"],
        "initial 1": ["mode 3", "0.37 m/s"], "sensor mid": ["velocity", "0.16", "10000 Hz"],
    }  # fmt: skip
    for heading, texts in expected.items():
        for text in texts:
            assert text in table[heading], (heading, table[heading])


@pytest.mark.parametrize(
    ("law", "expected", "others"),
    [
        ("penalty@newmark", ["k = 321 N/m", "c = 0.7 N s/m"], ["e =", "threshold"]),
        ("newton-penalty@newmark", ["e = 0.23", "k = 321 N/m", "threshold 0.004 m/s"], ["c ="]),
        ("newton@moreau-jean", ["e = 0.23", "threshold 0.004 m/s"], ["k =", "c ="]),
        ("none@newmark", [], ["e =", "k =", "c =", "threshold"]),
    ],
)
def test_the_numbers_that_a_law_reads_are_shown(
    law: str, expected: list[str], others: list[str]
) -> None:
    keys = ("contact.penalty_stiffness=321", "contact.penalty_damping=0.7",
            "contact.restitution=0.23", "contact.threshold_velocity=0.004",
            "mesh.elements=4", f"contact.law={law}")  # fmt: skip
    result = invoke("check", "default", *(word for key in keys for word in ("--set", key)))
    assert result.exit_code == 0, result.stderr
    numbers = rows(result.stdout).get("numbers of the law", "")
    assert all(text in numbers for text in expected), numbers
    assert not any(text in numbers for text in others), numbers


def test_a_point_is_shown_with_its_mass_and_without_sizes(tmp_path: Path) -> None:
    file = tmp_path / "point.toml"
    file.write_text(POINT, encoding="utf-8")
    lamina = rows(invoke("check", file).stdout)["lamina beam"]
    assert "1.25 kg" in lamina
    assert "300 N/m" in lamina
    assert "mm" not in lamina


def test_a_case_that_needs_much_is_shown(tmp_path: Path) -> None:
    checked = invoke("check", "paper", "--set", "time.periods=1000000000")
    table = rows(checked.stdout)
    assert {"lamina thick", "time", "needs"} <= set(table)
    assert "GB" in table["needs"]
    assert "--yes" in checked.stderr


LEVEL = """name = "two strips"
[[lamina]]
name = "steel"
length = 0.3
width = 0.03
thickness = 0.001
material = "steel"
damping_ratio = 0.01
[[lamina]]
name = "aluminium"
length = 0.3
width = 0.03
thickness = 0.002
material = "aluminium"
damping_ratio = 0.01
[gap]
tip = 0.001
exponent = 2.0
[mesh]
elements = 10
[excitation]
kind = "harmonic"
frequency = 10.0
amplitude = 1e-4
[contact]
law = "newton-penalty"
[time]
periods = 2
"""


def test_what_sags_more_than_a_tenth_of_the_gap_is_told(tmp_path: Path) -> None:
    """q L⁴ / 8 EI is 4.45 mm for a steel strip of 300 × 1 mm, 1.15 mm for aluminium of 2 mm."""
    path = tmp_path / "two.toml"
    path.write_text(LEVEL)
    told = invoke("check", path)
    assert told.exit_code == 0
    assert "steel sags by 4.45 mm and aluminium sags by 1.15 mm" in told.output
    path.write_text(LEVEL.replace("[mesh]", "[gravity]\nroll = 90\n[mesh]"))
    assert "sags" not in invoke("check", path).output
    assert "sags" not in invoke("check", path, "--set", "gravity.inclination=90").output


def test_the_state_of_rest_is_shown(tmp_path: Path) -> None:
    path = tmp_path / "two.toml"
    path.write_text(
        LEVEL.replace("[mesh]", "[gravity]\nroll = 180\n[[load]]\naxial = -3.0\n[mesh]")
    )
    output = " ".join(invoke("check", path).output.split())
    assert "tension -3 N, all" in output
    assert "at rest │ steel +" in output
    assert "pressed together │ steel-aluminium by" in output
    assert "gaps in place │ steel-aluminium" in output
    assert "buckles │ at" in output
