"""A single lamina has no delamination to find: what asks for one says so."""

from __future__ import annotations

import pytest

import delam_fem as df

LAMINA = {
    "name": "only", "length": 0.4, "width": 0.02, "thickness": 0.002, "material": "aluminium",
    "damping_ratio": 0.005,
}  # fmt: skip


@pytest.mark.parametrize("end", ["clamped", "free"])
@pytest.mark.parametrize(
    ("study", "options"),
    [
        ("detect", {}),
        ("modulate", {"pump_frequency": 11.0, "pump_amplitude": 0.1}),
        ("tap", {}),
    ],
    ids=["scan", "modulate", "tap"],
)
def test_one_lamina_is_refused(study: str, options: dict[str, float], end: str) -> None:
    case = df.Case(
        name="one",
        lamina=[LAMINA],
        support={"start": "clamped", "end": end},
        mesh={"elements": 8},
        excitation={"kind": "harmonic", "frequency": 63.7, "acceleration": 0.1},
        contact={"law": "penalty", "penalty_stiffness": 1e5},
        time={"scheme": "newmark", "steps_per_period": 500, "periods": 2},
        impactor=[
            {"lamina": "only", "position": 0.2, "mass": 0.01, "gap": 0.001, "velocity": 1.0,
             "stiffness": 1e5}
        ] if study == "tap" else [],
    )  # fmt: skip
    with pytest.raises(df.CaseError, match=r"expected .*\[\[delamination\]\].*, given"):
        getattr(df, study)(case, **options)
