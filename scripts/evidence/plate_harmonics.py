"""Harmonics over the amplitude of a plate with a patch, on and off its defect resonance.

    python scripts/evidence/plate_harmonics.py

The plate is that of the tutorial (docs/tutorials/plate.md), with a patch that is closed at rest,
one that is open by 1 µm in its middle, and one that a load or its weight presses shut. The force
drives it at half of the defect resonance, so that 2f meets it, and beside it. Pressed shut it is
given in parts of the force that opens the first pair, which `opening_amplitude` computes without
time steps. The tables of docs/evidence/plate_detection.md are written. It takes a processor minute.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from delam_fem.api import Case, assemble, opening_amplitude
from delam_fem.studies.detection.detect import in_modes, simulated
from delam_fem.studies.detection.study import Scan
from delam_fem.studies.signals.scan import shapes_of

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/evidence/plate_detection.md"
TUTORIAL = ROOT / "docs/tutorials/plate.md"
FREQUENCIES = {"2f at the defect resonance": 693.0, "2f beside it": 500.0}
"""Frequencies of the force [Hz]; the defect resonance is at 1,386 Hz."""
FORCES = (0.1, 1.0, 10.0, 100.0)
"""Amplitudes of the force [N]."""
PATCHES = {
    "closed": {},
    "closed, no threshold velocity": {"contact.threshold_velocity": 0.0},
    "open by 1 µm": {"delamination.1.opening": 1e-6},
}
"""Patches by name, with their keys."""
RIGID = {"contact.law": "newton@moreau-jean", "contact.restitution": 0.0}
"""Contact that bears a load without a spring."""
PRESSED = {
    "20 N": {
        "load": [{"between": ["lower", "upper"], "position": [0.085, -0.0075], "force": 20.0}]
    },
    "weight": {"gravity.acceleration": 9.80665},
}
"""What presses the patch shut, with its keys."""
SHARES = (0.5, 0.9, 1.1, 1.5, 2.0, 10.0)
"""Force over that which opens the first pair."""
SCAN = Scan(periods=16)
SETTLED = 1e-3
"""Share of a free motion that is left when a record begins."""


def case() -> Case:
    """Return the plate of the tutorial."""
    text = TUTORIAL.read_text("utf-8")
    block = re.search(r"```toml\n(.*?)```", text, re.DOTALL)
    assert block is not None
    return Case.from_toml(block[1])


def levels(model: Case, frequency: float, force: float) -> dict[float, float]:
    """Return the largest |V_k| over that of V_1 at the points of the scan, by order [dB]."""
    keys = {"excitation.frequency": frequency, "excitation.amplitude": force}
    field = simulated(model.with_overrides(keys), SCAN, left=SETTLED)
    shapes = shapes_of(field.field, field.times, frequency, field.x, z=field.z)
    largest = {k: float(np.abs(shapes.order(k)).max()) for k in (0.5, 1.0, 2.0, 3.0)}
    return {k: 20.0 * np.log10(value / largest[1.0]) for k, value in largest.items()}


def row(words: Sequence[str], decibels: dict[float, float]) -> str:
    """Return a row of a table."""
    numbers = (f"{decibels[k]:.0f}" for k in (2.0, 3.0, 0.5))
    return f"| {' | '.join((*words, *numbers))} |"


def over_force() -> list[str]:
    """Return the table of patches over the force."""
    lines = [
        "| patch | drive | force [N] | 2f [dB] | 3f [dB] | ½f [dB] |",
        "|---|---|---|---|---|---|",
    ]
    for name, keys in PATCHES.items():
        with tempfile.TemporaryDirectory() as folder:
            model = in_modes(case().with_overrides(keys), 40, Path(folder))
            for words, frequency in FREQUENCIES.items():
                for force in FORCES:
                    texts = (name, f"{frequency:g} Hz, {words}", f"{force:g}")
                    lines.append(row(texts, levels(model, frequency, force)))
    return lines


def pressed() -> list[str]:
    """Return the table of patches that are pressed shut."""
    lines = [
        "| pressed by | drive | opens at [N] | force over that | 2f [dB] | 3f [dB] | ½f [dB] |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, keys in PRESSED.items():
        with tempfile.TemporaryDirectory() as folder:
            model = in_modes(case().with_overrides(keys | RIGID), 40, Path(folder))
            operators = assemble(model).operators
            for frequency in FREQUENCIES.values():
                opens = opening_amplitude(operators, frequency)
                assert opens is not None
                for share in SHARES:
                    texts = (name, f"{frequency:g} Hz", f"{opens:.3g}", f"{share:g}")
                    lines.append(row(texts, levels(model, frequency, share * opens)))
    return lines


def written(text: str, name: str, lines: Sequence[str]) -> str:
    """Return the text of a page with a table between its marks."""
    before, remainder = text.split(f"<!-- {name} -->")
    _, after = remainder.split(f"<!-- /{name} -->")
    table = "\n".join(lines)
    return f"{before}<!-- {name} -->\n{table}\n<!-- /{name} -->{after}"


def main() -> None:
    """Compute the tables, and write them."""
    text = written(PAGE.read_text("utf-8"), "harmonics", over_force())
    PAGE.write_text(written(text, "pressed", pressed()), "utf-8")


if __name__ == "__main__":
    main()
