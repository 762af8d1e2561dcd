"""Pictures of the deformed laminae show what is stored of them."""

from collections.abc import Callable

import golden
import pytest
import xarray as xr
from stack import three_laminae
from synthetic import small_case, synthetic_history

from delam_fem import Case
from delam_fem.results.fields import pictures


def two_laminae(supported: bool = False) -> tuple[xr.Dataset, Case]:
    """Return a motion of two laminae, of cantilevers or between a clamp and a support."""
    case = small_case(**({"support__end": "pinned"} if supported else {}))
    history = synthetic_history(case)
    if supported:
        for name in ("displacement", "velocity", "gap0"):
            history[name] = 1e-3 * history[name]  # too small to be seen
    return history, case


@pytest.mark.parametrize("kind", ["two", "small", "three", "without strikes"])
def test_pictures_are_the_stored_ones(kind: str, stored: Callable[..., None]) -> None:
    history, case = two_laminae(kind == "small")
    if kind == "three":
        recorded = three_laminae()
        history, case = recorded.history(), recorded.case
    if kind == "without strikes":
        history = history.isel(event=slice(0, 0))
    stored(golden.describe(pictures.draw(pictures.drawable_frames(history), case)))
