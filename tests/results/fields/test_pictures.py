"""Pictures of the deformed laminae show what is stored of them."""

from collections.abc import Callable

import golden
import pytest
from stack import three_laminae
from synthetic import small_case, synthetic_history

from delam_fem.results.fields import pictures


@pytest.mark.parametrize("kind", ["two", "small", "three", "without strikes"])
def test_pictures_are_the_stored_ones(kind: str, stored: Callable[..., None]) -> None:
    case = small_case()
    history = synthetic_history(case)
    if kind == "small":
        for name in ("displacement", "gap0"):
            history[name] = 1e-3 * history[name]  # too small to be seen
    if kind == "three":
        recorded = three_laminae()
        history, case = recorded.history(), recorded.case
    if kind == "without strikes":
        history = history.isel(event=slice(0, 0))
    stored(golden.describe(pictures.draw(pictures.drawable_frames(history), case)))
