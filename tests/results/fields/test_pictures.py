"""Pictures of the deformed laminae show what is stored of them."""

from collections.abc import Callable
from pathlib import Path

import golden
import numpy as np
import pytest
import xarray as xr
from stack import STOPS, three_laminae, with_stops
from synthetic import small_case, synthetic_history

from delam_fem.case.definition import Case
from delam_fem.case.sections import InnerSupport, Support
from delam_fem.results.fields import pictures
from delam_fem.results.schema import add


@pytest.mark.parametrize("kind", ["two", "small", "three", "without strikes", "pinned", "free"])
def test_pictures_are_the_stored_ones(kind: str, stored: Callable[..., None]) -> None:
    case = small_case()
    history = synthetic_history(case)
    if kind == "small":
        for name in ("displacement", "gap0"):
            history[name] = 1e-3 * history[name]  # too small to be seen
    if kind == "three":
        recorded = three_laminae()
        history, case = recorded.history(), recorded.case
    if kind in ("pinned", "free"):
        support = Support(start=kind, end="clamped")  # type: ignore[arg-type]
        case = case.model_copy(update={"support": support})
        history["displacement"].to_numpy()[0, :, 0] = 0.02
        history["displacement"].to_numpy()[0, :, -1] = -0.01
    if kind == "without strikes":
        history = history.isel(event=slice(0, 0))
    stored(golden.describe(pictures.draw(pictures.drawable_frames(history), case)))


def of_ribbons(own: pictures.Ribbons, frames: tuple[int, ...]) -> str:
    """Return the mesh, the blocks and the fields of some frames."""
    mesh = own.mesh
    told = [f"{mesh.cell} {mesh.cells.shape}", golden.values_of(mesh.cells)]
    told += [golden.values_of(part) for part in (*mesh.points.T, mesh.cell_data["lamina"])]
    told += [
        f"{m.lamina} {m.node} {m.x:.6g} {m.side} {m.rest:.6g} {m.heat:.4g} "
        f"{golden.numbers(m.motion)}; {golden.numbers(m.state)}"
        for m in own.marks
    ]
    told += [golden.values_of(block) for mark in own.blocks for block in mark.T]
    for frame in frames:
        for name, values in own.point_data(frame).items():
            parts = values.T if values.ndim == 2 else [np.where(np.isinf(values), -99.0, values)]
            told += [f"{frame} {name} {values.dtype} {golden.numbers(part)}" for part in parts]
    return "\n".join(told)


def three_with_stops() -> tuple[xr.Dataset, Case]:
    """Return three laminae with stops, an impactor and supports inside the span."""
    recorded = three_laminae()
    inside = (
        InnerSupport(position=0.3, kind="pinned", lamina="thin"),
        InnerSupport(position=0.52, kind="spring", stiffness=1.0),
    )
    case = recorded.case.model_copy(update={"stop": STOPS, "support": Support(inside=inside)})
    return with_stops(recorded.history()), case


def test_stops_that_take_no_heat_are_drawn() -> None:
    """Contact points without mass lose nothing, and their results have no heat."""
    history, case = three_with_stops()
    known = pictures.marks(history, case)
    found = pictures.marks(history.drop_vars("stop_heat"), case)
    assert [mark.heat for mark in found] == [0.0] * len(known)
    assert max(mark.heat for mark in known) == 4e-3


@pytest.mark.parametrize("enlarged", [1.0, 20.0])
def test_ribbons_and_blocks_are_the_stored_ones(
    enlarged: float, stored: Callable[..., None]
) -> None:
    history, case = three_with_stops()
    add(history, heat=np.array([np.linspace(0.0, 1e-3, 6), np.linspace(2e-3, 0.0, 6)]))
    last = history.sizes["frame"] - 1
    stored(of_ribbons(pictures.Ribbons.of(history, case, enlarged), (2, last)))


def test_fields_are_the_stored_ones(stored: Callable[..., None]) -> None:
    """Of a law with springs and dampers, and of one with springs alone."""
    told = []
    for law in ("penalty", "newton-penalty", "newton"):
        case = small_case(contact__law=law, contact__penalty_damping=3.0)
        history = synthetic_history(case)
        history["slope"] = 1.1 * history["slope"]
        history["spring_share"] = history["spring_share"] * np.linspace(0.5, 1.5, 6)
        told.append(of_ribbons(pictures.Ribbons.of(history, case), (1, 21)))
    stored("\n".join(told))


@pytest.mark.parametrize(
    ("largest", "gap", "factor"),
    [
        (0.01, 0.0, 1.0), (0.0099, 0.0, 2.0), (0.0, 0.01, 1.0), (0.0, 0.008, 5.0), (0.0, 0.0, 1.0),
        (0.004, 0.001, 10.0), (0.0041, 0.004, 5.0), (0.002, 0.0, 20.0), (0.00201, 0.0, 10.0),
        (0.0008, 0.0, 50.0), (0.00081, 0.0, 20.0), (4.1e-5, 0.0, 500.0),
    ],
)  # fmt: skip
def test_factors_of_deflections(largest: float, gap: float, factor: float) -> None:
    """1, 2 or 5 times a power of ten, so that 4 % of the length is not exceeded."""
    history = xr.Dataset(
        {"displacement": (("lamina", "frame", "node"), np.zeros((2, 3, 4))),
         "gap0": ("node", np.zeros(4))}
    )  # fmt: skip
    history["displacement"].to_numpy()[1, 1, 2] = -2.0 * largest
    history["displacement"].to_numpy()[0, 2, 1] = 9.0
    history["gap0"].to_numpy()[3] = 2.0 * gap
    assert pictures.magnification(history, [0, 1], 2.0) == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize("periodic", [True, False])
def test_the_last_period_is_written_frame_by_frame(tmp_path: Path, periodic: bool) -> None:
    sweep = {"kind": "sweep", "start_frequency": 1.0, "end_frequency": 4.0, "duration": 12.5,
             "amplitude": 0.001}  # fmt: skip
    case = small_case(**({} if periodic else {"excitation": sweep}))
    history = synthetic_history(case).isel(frame=slice(0, 45))
    (tmp_path / "fields_999.vtu").write_text("of an earlier run")
    series, collection = pictures.write_fields(history, case, tmp_path)
    names = sorted(path.name for path in tmp_path.glob("*.vtu"))
    n = 20 if periodic else 45
    assert names == [f"fields_{k:02d}.vtu" for k in range(n)]
    times = history["frame"].to_numpy()[-n:].tolist()
    entries = [
        f'    <DataSet timestep="{time!r}" group="" part="0" file="{name}" />'
        for time, name in zip(times, names, strict=True)
    ]
    assert collection.read_text().splitlines() == [
        "<?xml version='1.0' encoding='utf-8'?>",
        '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
        "  <Collection>", *entries, "  </Collection>", "</VTKFile>",
    ]  # fmt: skip
    assert series.name == "fields.vtkhdf"
    ten = pictures.write_fields(history.isel(frame=slice(0, 10)), case, tmp_path / "ten")
    assert ten and len(list((tmp_path / "ten").glob("fields_?.vtu"))) == 10
