"""`identify natural`.

A clamped beam of 0.5 m; the place of a second clamp is sought. The first frequency has an error of
0.2 or 1 Hz; stiffness (± 10 %), damping and clamps are drawn.

A clamped beam of 0.5 m, with a second clamp whose place is sought between 0.05 and 0.25 m from its
end. Its first frequency is measured with an error of 0.2 or 1 Hz. What is uncertain is drawn, too,
as the command does by itself: stiffness (± 10 %), damping, and clamps that yield. *As modelled*:
truths are drawn as the table is. The note has the median width and that of the prior, both of 90 %.
The error of the interpolation is that from half of the simulations, so that 90 % are promised at
least.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from calibration.row import OWN, Row

import delam_fem as df
from delam_fem.api import Case, assemble, elastic
from delam_fem.studies.identification.unknowns import drawn, of_rig
from delam_fem.studies.signals.writing import write_measured

LEVEL = 0.9
TRUTHS = 200
LOW = 0.05
HIGH = 0.25
ERRORS = (0.2, 1.0)
PLACE = "support.2.position"
CASE = Case(
    name="moving", support=[{"start": "clamped"}, {"kind": "clamped", "position": 0.1}],
    lamina=[{"name": "one", "length": 0.5, "width": 0.02, "thickness": 0.002,
             "mass_per_length": 0.1, "bending_stiffness": 10.0, "damping_ratio": 0.01}],
    mesh={"elements": 4}, contact={"law": "none"},
    excitation={"kind": "harmonic", "amplitude": 0.0, "frequency": 20.0},
)  # fmt: skip


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return the rows of the page."""
    result = []
    truths = TRUTHS if is_long else 20
    clamp = 2.0 * of_rig(CASE)[-1].low
    rigs = {
        OWN: drawn(of_rig(CASE), CASE, truths, 3),
        "EI + 5 %": {"lamina.one.bending_stiffness": np.full(truths, 10.5)},
        "EI − 5 %": {"lamina.one.bending_stiffness": np.full(truths, 9.5)},
        "soft clamps (k L/EI = 100)": {of_rig(CASE)[-1].keys(CASE)[0]: np.full(truths, clamp)},
        "8 elements, not 4": {"mesh.elements": np.full(truths, 8)},
    }
    history = folder / "history.csv"
    history.write_text("time [s],y [m]\n0,1e-3\n0.5,-1e-3\n1,1e-3\n", encoding="utf-8")
    for number, (rig, keys) in enumerate(rigs.items() if is_long else [(OWN, rigs[OWN])]):
        rng = np.random.default_rng([57, number])
        places = rng.uniform(LOW, HIGH, truths)
        errors = rng.choice(ERRORS, truths)
        frequencies = [
            first_frequency({PLACE: place, **{key: v[k].item() for key, v in keys.items()}})
            for k, place in enumerate(places.tolist())
        ]
        names = {"free_frequency": frequencies + errors * rng.standard_normal(truths),
                 "free_frequency_error": errors}  # fmt: skip
        data = df.read_measured(history).assign_coords(free_time=np.arange(float(truths)))
        for name, values in names.items():
            data[name] = ("free_time", values)
        path = write_measured(data, folder / f"{number}.nc")
        unknown = (f"{PLACE}={LOW}:{HIGH}",)
        ends = df.natural(CASE, folder / f"{number}", measured=path, unknown=unknown).quantiles
        low, _, high = ends[:, :, 0].T
        inside = int(np.sum((low <= places) & (places <= high)))
        note = f"{1e3 * np.median(high - low):.3g} of {1e3 * LEVEL * (HIGH - LOW):.3g} mm"
        result.append(
            Row(f"{PLACE}, 90 % interval", rig, LEVEL, inside, truths, at_least=True, note=note)
        )
    return result


def first_frequency(keys: dict[str, float]) -> float:
    """Return the first natural frequency of the beam with other keys [Hz]."""
    case = CASE.with_overrides(keys)
    o = assemble(case, needs_dolfinx=False).operators
    return float(elastic(o.stiffness, o.mass, 1, case.n_rigid)[0][-1])
