"""Points of a scan, and shapes beside sums that are written down."""

from __future__ import annotations

import math

import numpy as np
import pytest

from delam_fem.api import CaseError, assemble, preset
from delam_fem.studies.signals.scan import (
    ORDERS,
    Shapes,
    amplitudes,
    at_points,
    scan_positions,
    shapes_of,
    surface_of,
)


def test_points_are_equidistant_from_the_first_to_the_length() -> None:
    np.testing.assert_allclose(scan_positions(1.0, 0.2, 0.1), [0.1, 0.3, 0.5, 0.7, 0.9])
    assert scan_positions(0.3, 0.1 / 3.0).size == 10  # round-off of the last one
    last = scan_positions(0.3, 0.1 / 3.0)[-1]
    assert last == 0.3
    assert scan_positions(1.0, 0.25).tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    for arguments in ((1.0, 0.2501, 0.0), (1.0, 0.0, 0.0), (1.0, -0.1, 0.0), (1.0, 0.1, -0.1)):
        with pytest.raises(CaseError) as error:
            scan_positions(*arguments)
        assert str(error.value) == (
            "scan: expected at least 5 points on the length 1 m, given a first point at "
            f"{arguments[2]:g} m and a spacing of {arguments[1]:g} m"
        )


def test_the_thinner_outermost_lamina_is_scanned_unless_told() -> None:
    case = preset("paper")
    assert surface_of(case, None) == "thin" and surface_of(case, "thick") == "thick"
    turned = case.model_copy(update={"lamina": case.lamina[::-1]})
    assert surface_of(turned, None) == "thin"
    same = case.with_overrides({"lamina.thick.thickness": 0.001})
    assert surface_of(same, None) == "thin"  # the last of two equal ones


def test_the_motion_between_nodes_is_that_of_a_cubic() -> None:
    """And the base moves with it; the scan knows no other lamina."""
    structure = assemble(preset("paper", {"mesh.elements": 3}), needs_dolfinx=False)
    h = 0.685 / 3
    x, nodes = np.array([0.0, 0.1, h, 0.4, 0.685]), h * np.arange(1, 4)
    vectors = np.zeros((2, structure.operators.n_dofs))
    part = structure.layout.parts[1]
    for row, (a, b) in enumerate(((1.0, 2.0), (-0.5, 0.3))):
        vectors[row, part.dofs[1:, 0]] = a * nodes**2 + b * nodes**3
        vectors[row, part.dofs[1:, 1]] = 2.0 * a * nodes + 3.0 * b * nodes**2
    base = np.array([0.0, 0.0])
    values = at_points(structure, "thin", x, vectors, base)
    np.testing.assert_allclose(values, [x**2 + 2.0 * x**3, -0.5 * x**2 + 0.3 * x**3], atol=1e-14)
    assert not at_points(structure, "thick", x, vectors, base).any()
    moved = at_points(structure, "thin", x, vectors, np.array([0.2, -0.1]))
    np.testing.assert_allclose(moved[:, 0], [0.2, -0.1])
    with pytest.raises(CaseError) as error:
        at_points(structure, "top", x, vectors, base)
    assert str(error.value) == "scan: lamina: expected one of thick, thin, given 'top'"


F, X = 7.0, np.array([0.0, 0.1, 0.4, 0.45, 0.9])


def test_records_are_long_enough_from_four_periods_on() -> None:
    assert ORDERS == (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    for n, is_enough in ((4 * 20, True), (4 * 20 - 1, False)):
        times = 3.0 + np.arange(n) / (20.0 * F)
        field = np.cos(2.0 * np.pi * F * times)[:, None] * X
        if is_enough:
            shapes = shapes_of(field, times, F, X)
            assert shapes.orders == ORDERS and shapes.n_lines == 2  # 7/4 and 9/4
        else:
            with pytest.raises(ValueError, match="at least 4 periods of 7 Hz, given 3"):
                shapes_of(field, times, F, X)


def test_noise_is_what_stands_between_the_harmonics() -> None:
    """Lines between 1.5 and 2.5 of which none is a harmonic; those at the ends do not count."""
    n, times = 8, np.arange(8 * 32) / (32.0 * F)
    lines = {k / 8: 0.1 * k for k in range(13, 20) if k != 16}
    field = sum(a * np.cos(2.0 * np.pi * k * F * times + k) for k, a in lines.items())
    outside = sum(9.0 * np.cos(2.0 * np.pi * k * F * times) for k in (12 / 8, 20 / 8, 2.0, 1.0))
    shapes = shapes_of((field + outside)[:, None] * X, times, F, X, orders=(1.0, 1.5, 2.0, 2.5))
    rms = np.sqrt(np.mean(np.square(list(lines.values()))))
    np.testing.assert_allclose(shapes.noise, rms * X, rtol=1e-9, atol=1e-12)
    assert shapes.n_lines == len(lines) == n - 2
    np.testing.assert_allclose(np.abs(shapes.values), 9.0 * np.outer(np.ones(4), X), atol=1e-9)


def test_amplitudes_refuse_what_is_not_finite() -> None:
    field = np.ones((4, 3))
    field[1, 2], field[3, 0] = np.nan, np.inf
    for values, told in ((field, "2 others among 12"), (np.zeros((0, 3)), "0 others among 0")):
        with pytest.raises(CaseError) as error:
            amplitudes(values, np.arange(len(values)), [1.0])
        assert str(error.value) == (
            f"shapes: expected samples that are finite numbers, given {told}"
        )


def test_noise_adds_to_what_is_there() -> None:
    values = np.ones((2, X.size), complex)
    shapes = Shapes(X, F, (1.0, 2.0), values, 0.3)
    assert (shapes.n_lines, Shapes(X, F, (1.0,), values[:1]).noise) == (math.inf, 0.0)
    noisy_shapes = shapes.noisy(0.4, np.random.default_rng(2))
    parts = np.random.default_rng(2).normal(scale=0.4 / math.sqrt(2.0), size=(2, 2, X.size))
    np.testing.assert_allclose(noisy_shapes.values, values + parts[0] + 1j * parts[1], rtol=1e-14)
    assert noisy_shapes.noise == pytest.approx(0.5) and noisy_shapes.n_lines == math.inf
    rng = np.random.default_rng(2)
    known = shapes.noisy(np.linspace(0.1, 0.5, X.size), rng, 6)
    again = np.random.default_rng(2)
    again.normal(size=(2, 2, X.size))
    gamma = again.gamma(6, 1.0 / 6, size=X.size)
    wanted = np.hypot(0.3, np.linspace(0.1, 0.5, X.size)) * np.sqrt(gamma)
    np.testing.assert_allclose(known.noise, wanted, rtol=1e-14)
    assert known.n_lines == 6
    with pytest.raises(ValueError, match="not in"):
        shapes.order(3.0)


@pytest.mark.parametrize("noise", [0.0, 0.02, np.linspace(0.01, 0.05, 25)])
def test_the_drives_own_harmonics_are_fitted_to_second_differences(
    noise: float | np.ndarray,
) -> None:
    """Least squares with weights of 1 / max(|r|, least) / least, in twenty passes."""
    x = np.linspace(0.0, 1.0, 25)
    response = np.cos(3.0 * x) + 0.2j * x**2
    bulge = np.exp(-(((x - 0.6) / 0.1) ** 2))
    values = np.stack([x + 0j, bulge + (0.5 - 1.5j) * response, 2.0 * bulge + 0j])
    shapes = Shapes(x, F, (1.0, 2.0, 3.0), values, noise)
    corrected = shapes.without_drive({2.0: response, 9.0: response})
    np.testing.assert_array_equal(corrected.values[[0, 2]], values[[0, 2]])
    curvature, drive_curvature = np.diff(values[1], 2), np.diff(response, 2)
    all_noise = np.broadcast_to(noise, x.shape)
    least = np.sqrt(all_noise[:-2] ** 2 + all_noise[2:] ** 2 + 4.0 * all_noise[1:-1] ** 2)
    least = least + np.finfo(float).tiny ** 0.25
    c, weights = 0.0, 1.0 / least**2
    for _ in range(20):
        c = (weights * drive_curvature.conj() * curvature).sum() / (
            weights * np.abs(drive_curvature) ** 2
        ).sum()
        weights = 1.0 / (least * np.maximum(np.abs(curvature - c * drive_curvature), least))
    np.testing.assert_allclose(corrected.values[1], values[1] - c * response, rtol=1e-8, atol=1e-10)
    np.testing.assert_array_equal(shapes.values, values)
