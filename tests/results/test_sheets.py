"""The surface of a reduced plate: what its file keeps, and what ParaView is given."""

from dataclasses import replace

import numpy as np
import pytest
from plates import PATCH, patched

import delam_fem as df
from delam_fem.api import assemble, reduced_case
from delam_fem.model.reduction_file import write
from delam_fem.results.fields import vtkhdf

LENGTH, WIDTH = 0.12, 0.1
CASE = patched(
    delamination=[PATCH | {"across": [-0.03, 0.03], "opening": 2e-5}],
    time={"steps_per_period": 100, "periods": 2},
    output={"window_periods": 1, "fields_per_period": 10},
)


@pytest.fixture(scope="module")
def reduced(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plate")
    structure = assemble(CASE)
    reduced_case(CASE, 10, full=structure).save(folder)
    return structure, df.load_case(folder / "case.toml")


def test_sheets_move_as_the_middle_of_the_body_does(reduced):
    small = assemble(reduced[1])
    sheets = small.layout.sheets
    rng = np.random.default_rng(2)
    q = rng.normal(size=(3, small.operators.n_dofs))
    moved = sheets.of(q, np.ones(3))
    # independent: the points of the middle line, which have readings of their own
    part = small.layout.parts[1]
    read = small.layout.read(q, np.ones(3))[:, part.dofs[:, 0]]
    on_line = np.flatnonzero((sheets.part == 1) & (np.abs(sheets.points[:, 2]) < 1e-9))
    assert on_line.size
    for k in on_line:
        number = np.abs(part.x - sheets.points[k, 0]).argmin()
        if abs(part.x[number] - sheets.points[k, 0]) < 1e-9:
            np.testing.assert_allclose(moved[:, k], read[:, number], rtol=1e-4, atol=1e-6)


def test_cells_cover_each_lamina_and_look_upwards(reduced):
    sheets = assemble(reduced[1]).layout.sheets
    corners = sheets.points[sheets.cells]
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    assert (across[:, 1] > 0.0).all()
    for part, thickness in ((0, 0.0014), (1, 0.0006)):
        is_its = sheets.part[sheets.cells[:, 0]] == part
        assert 0.5 * across[is_its, 1].sum() == pytest.approx(LENGTH * WIDTH)
        np.testing.assert_allclose(sheets.thickness[sheets.part == part], thickness)
    heights = [sheets.points[sheets.part == part, 1].mean() for part in (0, 1)]
    assert heights[1] - heights[0] == pytest.approx(0.5 * (0.0014 + 0.0006))


def test_a_file_stays_below_ten_times_its_size_without_sheets(reduced, tmp_path):
    small = assemble(reduced[1])
    bare = replace(small, layout=replace(small.layout, sheets=None))
    for name, structure in (("with", small), ("bare", bare)):
        write(tmp_path / f"{name}.npz", structure, CASE, np.zeros((0, small.operators.n_dofs + 1)))
    sizes = [(tmp_path / f"{name}.npz").stat().st_size for name in ("with", "bare")]
    assert sizes[0] < 10.0 * sizes[1]


@pytest.mark.slow
def test_paraview_is_given_the_surface_with_the_opening(reduced, tmp_path):
    import pyvista as pv

    result = df.run(reduced[1])
    result.save(tmp_path, figures=False)
    grid = pv.read(tmp_path / "fields" / "surface.vtkhdf")
    assert {"displacement", "velocity", "opening", "rise"} <= set(grid.point_data)
    volume = grid.compute_cell_sizes()["Volume"]
    assert (volume > 0.0).all()
    # the laminae, and nothing of the wedge that the opening lifts
    assert volume.sum() == pytest.approx(LENGTH * WIDTH * 0.002, rel=1e-3)
    frames = result.plate
    assert (frames.pairs >= 0).all()  # pairs are at vertices of both laminae
    # the gap is what the sheets say: the distance of both laminae over that at rest
    upper, lower = frames.pairs[:, 1], frames.pairs[:, 0]
    gap0 = frames.rise[upper]
    assert gap0.max() == pytest.approx(2e-5, rel=0.2)
    apart = frames.motion[:, 0][:, upper] - frames.motion[:, 0][:, lower]
    np.testing.assert_allclose(apart + gap0, frames.openings, rtol=0.05, atol=2e-7)
    assert isinstance(frames.grid, vtkhdf.Grid)
