"""The gap at rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from delam_fem.api import CaseError, InitialGap, initial_gap, preset
from delam_fem.case.gap import opening_at_rest, read_gap_table, read_table
from delam_fem.case.sections import Delamination, Stop

L = 0.685
ROUND_OFF = 1e-13
"""A few operations on doubles."""


def table(folder: Path, text: str) -> InitialGap:
    """Return a gap given by a table."""
    path = folder / "gap.csv"
    path.write_text(text)
    return InitialGap(file=path)


@pytest.mark.parametrize("p", [1.0, 2.0, 3.5])
def test_power(p: float) -> None:
    g0 = initial_gap(InitialGap(tip=0.012, exponent=p), [0.0, L / 4, L], L)
    assert g0 == pytest.approx([0.0, 0.012 / 4**p, 0.012], rel=ROUND_OFF)


def test_square_is_the_default() -> None:
    assert InitialGap(tip=0.012) == InitialGap(tip=0.012, exponent=2.0)


def test_first_mode() -> None:
    # w1(1/2) = 0.33952 (tip 1), tabulated, e.g. Blevins, Formulas for natural frequency
    g0 = initial_gap(InitialGap(tip=0.012, shape="mode"), [0.0, L / 2, L], L)
    assert g0 == pytest.approx([0.0, 0.012 * 0.33952, 0.012], rel=2e-5, abs=1e-17)


@pytest.mark.parametrize("tip", [0.012, 0.0005, 0.0002])
def test_gap_at_the_root(tip: float) -> None:
    """Root 0.5 mm: half-way up the square it is 0.5 mm + (tip - 0.5 mm)/4; w1(1/2) as above."""
    square = initial_gap(InitialGap(tip=tip, root=0.0005), [0.0, L / 2, L], L)
    assert square == pytest.approx([0.0005, 0.000375 + tip / 4.0, tip], rel=ROUND_OFF)
    mode = initial_gap(InitialGap(tip=tip, root=0.0005, shape="mode"), [0.0, L / 2, L], L)
    assert mode == pytest.approx([0.0005, 0.0005 * 0.66048 + tip * 0.33952, tip], rel=2e-5)


def test_table_may_begin_with_a_gap_of_its_own(tmp_path: Path) -> None:
    gap = table(tmp_path, f"x,gap\n0,0.0005\n{L},0.0015\n")
    assert initial_gap(gap, [0.0, L / 2, L], L) == pytest.approx([0.0005, 0.001, 0.0015])
    with pytest.raises(CaseError, match=r"gap\.root: "):
        preset("paper", {"gap.file": str(gap.file), "gap.root": 0.001})
    assert (
        preset("paper", {"gap.root": 0.001}).with_overrides({"gap.file": str(gap.file)}).gap == gap
    )


def test_table_is_interpolated_without_overshoot(tmp_path: Path) -> None:
    rows = np.array([[0.0, 0.0], [0.2, 0.001], [0.3, 0.010], [0.5, 0.0101], [L, 0.012]])
    gap = table(
        tmp_path,
        "# measured\nx [m], gap [m]\n\n"
        + "".join(f"{float(x)!r}, {float(g)!r}  # row\n" for x, g in rows),
    )
    assert initial_gap(gap, rows[:, 0], L) == pytest.approx(rows[:, 1], rel=ROUND_OFF)
    fine = initial_gap(gap, np.linspace(0.0, L, 500), L)
    assert np.all(np.diff(fine) >= 0.0)
    assert fine.max() == pytest.approx(0.012, rel=ROUND_OFF)


def test_table_of_a_line_is_the_line(tmp_path: Path) -> None:
    gap = table(tmp_path, "\ufeffx,gap\n0,0\n0.3,0.003\n0.685,0.00685\n")
    x = np.linspace(0.0, L, 20)
    assert initial_gap(gap, x, L) == pytest.approx(0.01 * x, rel=ROUND_OFF, abs=1e-18)


def test_table_is_a_smooth_curve_between_the_rows(tmp_path: Path) -> None:
    """Slopes by Fritsch and Carlson for rows 1 apart, by hand: 0, 3/2, 4 m/m.

    A cubic with the ends f0, f1 and the slopes d0, d1 has (f0 + f1)/2 + (d0 - d1)/8 in the middle,
    and in the first quarter 27/32 f0 + 5/32 f1 + 9/64 d0 - 3/64 d1. A polygon has 0.5 and 2.5.
    """
    gap = table(tmp_path, "x,gap\n0,0\n1,1\n2,4\n")
    values = initial_gap(gap, [0.25, 0.5, 1.0, 1.5], 2.0)
    quarter = 5.0 / 32.0 - 3.0 / 64.0 * 1.5
    expected = [quarter, 0.5 + (0.0 - 1.5) / 8.0, 1.0, 2.5 + (1.5 - 4.0) / 8.0]
    assert values == pytest.approx(expected, rel=ROUND_OFF)


@pytest.mark.parametrize("end", [L * (1.0 - 0.9e-9), L * (1.0 + 1e-3)])
def test_table_may_end_by_round_off_before_the_tip_or_beyond_it(tmp_path: Path, end: float) -> None:
    gap = table(tmp_path, f"x,gap\n0,0\n{end!r},{0.01 * end!r}\n")
    assert initial_gap(gap, [L / 2, L], L) == pytest.approx([0.005 * L, 0.01 * L], rel=1e-8)


@pytest.mark.parametrize("x", [-0.9e-9 * L, 0.9e-9 * L])
def test_table_may_begin_by_round_off_beside_the_clamp(tmp_path: Path, x: float) -> None:
    gap = table(tmp_path, f"x,gap\n{x!r},{x!r}\n0.685,0.01\n")
    assert initial_gap(gap, [0.0, L], L).tolist() == [0.0, 0.01]


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (f"0,0\n{L * (1.0 - 1.2e-9)!r},0.01", "expected x from 0 to the length 0.685 m"),
        (f"{1.2e-9 * L!r},0\n{L},0.01", "expected x from 0 to the length 0.685 m"),
        (f"{-1.2e-9 * L!r},0\n{L},0.01", "expected x from 0 to the length 0.685 m"),
        (f"0,{-1.2e-9 * L!r}\n{L},0.01", "line 2: "),
    ],
)
def test_more_than_round_off_is_told(tmp_path: Path, rows: str, expected: str) -> None:
    with pytest.raises(CaseError, match=expected):
        initial_gap(table(tmp_path, f"x,gap\n{rows}\n"), [0.0, L], L)


def test_only_the_first_row_may_be_a_heading(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=r"line 2: .*given a word in column 1"):
        initial_gap(table(tmp_path, "x [m],gap [m]\nx,gap\n0,0\n0.685,0.01\n"), [L], L)
    with pytest.raises(CaseError, match=r"line 1: .*given a word in column 1"):
        initial_gap(table(tmp_path, "x,0\n0.685,0.01\n"), [L], L)


def test_a_gap_needs_a_tip_or_a_table() -> None:
    with pytest.raises(CaseError, match=r"gap\.tip: missing"):
        initial_gap(InitialGap.model_construct(tip=None, file=None, exponent=2.0), [L], L)


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ("0,0\n0.3,nan\n0.685,0.01", "line 3: expected finite numbers, given 0.3, nan"),
        ("0,0\n0.3,0.01,3\n0.685,0.01", "line 3: expected two numbers x, gap, given 3 columns"),
        ("0,0\n0.3,abc\n0.685,0.01", "line 3: expected two numbers"),
        ("0,0\n0.3,0.01\n0.3,0.02\n0.685,0.1", "line 4: expected x to increase, given 0.3 after 0"),
        ("0,0\n0.4,0.01\n0.3,0.02\n0.685,0.1", "line 4: expected x to increase, given 0.3 after 0"),
        ("0,0\n0.5,0.01", "expected x from 0 to the length 0.685 m, given 0.0 to 0.5"),
        ("0.1,0\n0.685,0.01", "expected x from 0 to the length 0.685 m, given 0.1 to 0.685"),
        ("0,-0.001\n0.685,0.01", "line 2: expected a gap of at least 0 at the clamp, given -0.001"),
        ("0,0\n0.7,0.01", "line 3: expected x up to the length 0.685 m of the lamina, given 0.7"),
        ("0,0\n0.3,0\n0.685,0.01", "line 3: the gap starts closed beyond the clamp: .* given 0.0"),
        ("0,0\n0.3,-1e-3\n0.685,0.01", "line 3: the gap starts closed .* given -0.001 m"),
        ("0,0", "expected at least two rows of x, gap, given 1"),
        ("", "expected at least two rows of x, gap, given 0"),
    ],
)
def test_bad_table_is_told_with_file_and_line(tmp_path: Path, rows: str, expected: str) -> None:
    with pytest.raises(CaseError, match=r"gap file /.*gap\.csv.*" + expected):
        initial_gap(table(tmp_path, f"x,gap\n{rows}\n"), [0.0, L], L)


def test_file_that_is_no_table(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=r"gap\.csv: cannot be read \(No such file"):
        initial_gap(InitialGap(file=tmp_path / "gap.csv"), [0.0, L], L)
    (tmp_path / "gap.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CaseError, match=r"gap\.csv: "):
        initial_gap(InitialGap(file=tmp_path / "gap.csv"), [0.0, L], L)


def test_power_that_rounds_to_closed() -> None:
    with pytest.raises(CaseError, match=r"gap starts closed beyond the clamp: .* given 0 m at x"):
        initial_gap(InitialGap(tip=0.012, exponent=400.0), [0.0, L / 20, L], L)


def test_a_table_in_millimetres_is_the_same_gap(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("x [m], gap [m]\n0,0\n0.3,0.004\n0.685,0.012\n")
    (tmp_path / "mm.csv").write_text("x [mm], gap [µm]\n0,0\n300,4000\n685,12000\n")
    x = np.linspace(0.1, 0.685, 7)
    in_m, in_mm = (
        initial_gap(InitialGap(file=tmp_path / f"{n}.csv"), x, 0.685) for n in ("m", "mm")
    )
    assert in_mm == pytest.approx(in_m, rel=1e-12)


ROWS = [(0.0, 0.0), (0.1, 0.001), (0.3, 0.004), (0.5, 0.003), (L, 0.012)]


def rows(*changed: tuple[int, tuple[float, float]], begin: int = 0, end: int = 5) -> str:
    """Return rows of a table, some of them changed, below two lines that are none."""
    lines = dict(enumerate(ROWS)) | dict(changed)
    return "# gap\n\n" + "".join(f"{lines[k][0]!r},{lines[k][1]!r}\n" for k in range(begin, end))


MARGIN = 1e-9 * L
EMPTY = "expected a positive gap"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (rows(begin=1), f" : expected x from 0 to the length {L} m, given 0.1 to {L}"),
        (rows((0, (1.1 * MARGIN, 0.0))), f" : expected x from 0 to the length {L} m, given "
         f"{1.1 * MARGIN} to {L}"),
        (rows((4, (L - 1.1 * MARGIN, 0.012))), f" : expected x from 0 to the length {L} m, given "
         f"0.0 to {L - 1.1 * MARGIN}"),
        (rows((0, (0.0, -1.1 * MARGIN))), ", line 3: expected a gap of at least 0 at the clamp, "
         f"given {-1.1 * MARGIN}"),
        (rows((2, (0.3, 0.0))), f", line 5: the gap starts closed beyond the clamp: {EMPTY}, given "
         "0.0 m"),
        (rows((3, (0.3, 0.1))), ", line 6: expected x to increase, given 0.3 after 0.3"),
        (rows((4, (L * 1.0021, 0.1))), f", line 7: expected x up to the length {L} m of the lamina,"
         f" given {L * 1.0021} m"),
        (rows(end=1), ": expected at least two rows of x, gap, given 1"),
    ],
)  # fmt: skip
def test_messages_of_tables_are_exact(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "gap.csv"
    path.write_text(text)
    with pytest.raises(CaseError) as error:
        read_gap_table(path, L)
    assert str(error.value) == f"gap file {path}{message.replace(' : ', ': ')}"


def test_tables_just_within_their_margins(tmp_path: Path) -> None:
    path, near = tmp_path / "gap.csv", 0.9 * MARGIN
    for clamp, clamp_gap in ((0.0, 0.0), (-near, 0.0), (near, 0.0), (1.1 * MARGIN, 1.1 * MARGIN)):
        path.write_text(rows((0, (-near, clamp)), (4, (L - near, 0.012))))
        x, gap = read_gap_table(path, L)
        assert x.tolist() == [0.0, 0.1, 0.3, 0.5, L - near]
        assert gap.tolist() == [clamp_gap, 0.001, 0.004, 0.003, 0.012]
        path.write_text(rows((0, (near, 0.0))))
        assert read_gap_table(path, L)[0][0] == 0.0
    path.write_text(rows((4, (L * 1.0019, 0.012))))
    x = np.array([0.0, 0.2, 0.4, L])
    values = initial_gap(InitialGap(file=path), np.r_[x, 2.0 * L], L)
    wanted = PchipInterpolator(*np.array([*ROWS[:4], (L * 1.0019, 0.012)]).T)
    np.testing.assert_allclose(values[:4], wanted(x), rtol=1e-12, atol=1e-18)
    assert values[4] == 0.012


def test_a_gap_that_is_closed_somewhere_is_refused() -> None:
    """Root 1 mm and a power of 1000 leave the gap open; without root it is round-off at once."""
    x = np.array([0.0, 0.1, 0.3, L])
    with pytest.raises(CaseError) as error:
        initial_gap(InitialGap(tip=0.012, exponent=1000.0), x, L)
    assert str(error.value) == (
        "gap.exponent 1000.0: the gap starts closed beyond the clamp: expected a positive gap at "
        "every node with x > 0, given 0 m at x = 0.1 m"
    )
    assert initial_gap(InitialGap(tip=0.012, root=0.001, exponent=1000.0), x, L)[1] == 0.001
    assert initial_gap(InitialGap(tip=0.012, exponent=2.0), [2.0 * L, -0.1], L).tolist() == [
        0.012,
        0.0,
    ]


def opening(**about: object) -> Delamination:
    return Delamination(between=("a", "b"), start=0.1, end=0.5, opening=0.004, **about)  # type: ignore[arg-type]


def test_openings_of_delaminations_and_stops(tmp_path: Path) -> None:
    x = np.array([0.05, 0.1, 0.2, 0.4, 0.5, 0.6])
    s = np.array([0.0, 0.0, 0.25, 0.75, 1.0, 1.0])
    arch = opening_at_rest(opening(), x, L)
    np.testing.assert_allclose(arch, 0.004 * np.sin(np.pi * s), atol=1e-17)
    for exponent, power in ((None, 2.0), (1.5, 1.5)):
        delamination = opening(shape="power", exponent=exponent)
        np.testing.assert_allclose(opening_at_rest(delamination, x, L), 0.004 * s**power)
        turned = opening_at_rest(delamination, x, L, opens_at_start=True)
        np.testing.assert_allclose(turned, 0.004 * (1.0 - s) ** power)
    stop = {"lamina": "a", "side": "above", "gap": 0.01}
    point = Stop(**stop, position=0.2)  # type: ignore[arg-type]
    assert opening_at_rest(point, x, L).tolist() == [0.0] * 6
    path = tmp_path / "g.csv"
    path.write_text(rows((3, (0.52, 0.0)), begin=1, end=4))
    stretch = Stop(**stop, start=0.1, end=0.5, file=path)  # type: ignore[arg-type]
    wanted = PchipInterpolator([0.1, 0.3, 0.52], [0.001, 0.004, 0.0])
    values = opening_at_rest(stretch, np.r_[x, 0.51, 0.55], L)
    inside = np.clip(np.r_[x, 0.51, 0.55], 0.1, 0.52)
    np.testing.assert_allclose(values, wanted(inside), rtol=1e-12, atol=1e-18)


def test_tables_of_openings_cover_them(tmp_path: Path) -> None:
    path, margin = tmp_path / "g.csv", 1e-9 * 0.5
    for first, last, is_taken in (
        (0.1 + 0.9 * margin, 0.5, True), (0.1 + 1.1 * margin, 0.5, False),
        (0.1, 0.5 - 0.9 * margin, True), (0.1, 0.5 - 1.1 * margin, False),
    ):  # fmt: skip
        path.write_text(rows((1, (first, 0.0)), (3, (last, 0.0)), begin=1, end=4))
        if is_taken:
            assert read_table(path, 0.1, 0.5, L)[1].tolist() == [0.0, 0.004, 0.0]
            continue
        with pytest.raises(CaseError) as error:
            read_table(path, 0.1, 0.5, L)
        told = f"gap file {path}: expected x from 0.1 to 0.5 m, given {first} to {last}"
        assert str(error.value) == told
    path.write_text(rows((2, (0.3, -1e-9)), begin=1, end=4))
    with pytest.raises(CaseError) as error:
        read_table(path, 0.1, 0.5, L)
    assert str(error.value) == (
        f"gap file {path}, line 4: expected a gap of at least 0, given -1e-09 m"
    )
