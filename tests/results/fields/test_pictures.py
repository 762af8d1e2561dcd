"""Pictures of the deformed laminae show what is stored of them."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from stack import STOPS, three_laminae, with_stops
from synthetic import small_case, synthetic_history

from delam_fem.api import Case
from delam_fem.case.sections import Support
from delam_fem.results.fields import pictures


def three_with_stops() -> tuple[xr.Dataset, Case]:
    """Return three laminae with stops, an impactor and supports inside the span."""
    recorded = three_laminae()
    support = Support.model_validate([
        {"position": 0.3, "kind": "pinned", "lamina": "thin"},
        {"position": 0.52, "kind": "spring", "stiffness": 1.0},
    ])  # fmt: skip
    case = recorded.case.model_copy(update={"stop": STOPS, "support": support})
    return with_stops(recorded.history()), case


def test_stops_that_take_no_heat_are_drawn() -> None:
    """Contact points without mass lose nothing, and their results have no heat."""
    history, case = three_with_stops()
    known = pictures.marks(history, case)
    marks = pictures.marks(history.drop_vars("stop_heat"), case)
    assert [mark.heat for mark in marks] == [0.0] * len(known)
    assert max(mark.heat for mark in known) == 4e-3


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
