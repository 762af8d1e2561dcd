"""The tap test: a hammer along a beam with a delamination, beside the defect as a spring.

Over a defect the layer above it gives way like a beam that is clamped at the edges (Cawley, Adams,
"The mechanics of the coin-tap method of non-destructive testing", J. Sound Vib. 122, 1988). With
that spring behind that of the contact, a tap lasts longer and is weaker.
"""

import numpy as np

import delam_fem as df

START, END, CONTACT, MASS, SPEED = 0.16, 0.24, 1e6, 0.05, 0.05  # m, m, N/m, kg, m/s
LAYER = {"length": 0.4, "width": 0.02, "material": "aluminium", "damping_ratio": 0.002}

case = df.Case(
    name="tap",
    lamina=[
        {"name": "lower", "thickness": 0.02} | LAYER,
        {"name": "upper", "thickness": 0.002} | LAYER,
    ],
    support={"start": "clamped", "end": "clamped"},
    delamination=[
        {"between": ["lower", "upper"], "start": START, "end": END, "opening": 1e-3},
    ],
    impactor=[
        {"lamina": "upper", "position": 0.1, "mass": MASS, "velocity": SPEED, "stiffness": CONTACT}
    ],
    sensor=[{"name": "tap", "quantity": "contact force", "impactor": 1}],
    mesh={"elements": 40},
    excitation={"kind": "harmonic", "frequency": 200.0, "amplitude": 0.0},  # a window of 5 ms
    contact={"law": "penalty", "penalty_stiffness": CONTACT},
    time={"steps_per_period": 2500, "periods": 1},
    output={"window_periods": 1, "fields_per_period": 0},
)


def tap(position: float) -> tuple[float, float]:
    """Return length [s] and largest force [N] of a tap."""
    history = df.run(
        case.with_overrides({"impactor.1.position": position}), engine="compiled"
    ).history
    force, step = history["sensor_tap"].to_numpy(), case.period / 2500
    return np.count_nonzero(force > 0.0) * step, force.max()


def spring(position: float) -> float:
    """Return the stiffness of the layer above the defect, clamped at its edges [N/m]."""
    a, x = END - START, position - START
    return 3.0 * case.lamina[1].flexural_rigidity * a**3 / (x * (a - x)) ** 3


sound, ratios = tap(0.1), []
print(f"sound: {1e3 * sound[0]:.2f} ms, {sound[1]:.2f} N")
for position in (0.165, 0.17, 0.18, 0.19, 0.2):
    length, force = tap(position)
    k = 1.0 / (1.0 / CONTACT + 1.0 / spring(position))
    expected = np.pi * np.sqrt(MASS / k), SPEED * np.sqrt(MASS * k)
    print(
        f"{1e3 * position:.0f} mm: {1e3 * length:.2f} ms, {force:.2f} N; as a spring of "
        f"{spring(position):.2e} N/m {1e3 * expected[0]:.2f} ms, {expected[1]:.2f} N"
    )
    ratios.append(length / expected[0])
assert np.abs(np.array(ratios) - 1.0).max() < 0.11
