"""Harmonics over the amplitude of a plate with a patch, on and off its defect resonance.

    python scripts/evidence/plate_harmonics.py

The plate is that of the tutorial (docs/tutorials/plate.md), with a patch that is closed at rest and
one that is open by 1 µm in its middle. The force drives it at half of the defect resonance, so that
2f meets it, and beside it. The table of docs/evidence/plate_detection.md is written. It takes half
a processor minute.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import numpy as np

from delam_fem.api import Case
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
OPENINGS = {"closed": 0.0, "open by 1 µm": 1e-6}
"""Largest gap at rest [m]."""
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


def main() -> None:
    """Compute the table, and write it."""
    lines = [
        "| patch | drive | force [N] | 2f [dB] | 3f [dB] | ½f [dB] |",
        "|---|---|---|---|---|---|",
    ]
    for name, opening in OPENINGS.items():
        with tempfile.TemporaryDirectory() as folder:
            patch = case().with_overrides({"delamination.1.opening": opening})
            model = in_modes(patch, 40, Path(folder))
            for words, frequency in FREQUENCIES.items():
                for force in FORCES:
                    decibels = levels(model, frequency, force)
                    lines.append(
                        f"| {name} | {frequency:g} Hz, {words} | {force:g} | {decibels[2.0]:.0f} | "
                        f"{decibels[3.0]:.0f} | {decibels[0.5]:.0f} |"
                    )
    begin, end = "<!-- harmonics -->", "<!-- /harmonics -->"
    text = PAGE.read_text("utf-8")
    before, remainder = text.split(begin)
    _, after = remainder.split(end)
    table = "\n".join(lines)
    PAGE.write_text(f"{before}{begin}\n{table}\n{end}{after}", "utf-8")


if __name__ == "__main__":
    main()
