"""The values that an option takes."""

from typing import Any

import pytest

import delam_fem as df
from delam_fem.api import CaseError, Flag


@pytest.mark.parametrize("value", [1, 2, "2"])
def test_bounds_of_a_number_are_values_that_it_takes(value: Any) -> None:
    assert Flag(kind=int, least=1, most=2).checked("n", value) == int(value)


@pytest.mark.parametrize(("kind", "value"), [(int, 0), (int, 3), (int, 1.5), (float, 2.0000001)])
def test_what_lies_outside_is_told_with_its_bounds(kind: Any, value: Any) -> None:
    with pytest.raises(CaseError, match=r"\bn: .*given"):
        Flag(kind=kind, least=1, most=2).checked("n", value)


def test_several_values_are_taken_one_by_one() -> None:
    flag = Flag(kind=float, least=0.0, is_joined=True, is_several=True)
    assert flag.checked("f", "1, 2.5") == flag.checked("f", [1.0, 2.5]) == (1.0, 2.5)
    with pytest.raises(CaseError, match=r"given -1\.0"):
        flag.checked("f", "1,-1")


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"pump_frequency": 5.0}, "missing a required .*argument: 'pump_amplitude'"),
        ({"pump": 5.0}, "got an unexpected keyword argument 'pump'"),
        (
            {"pump_frequency": 5.0, "pump_amplitude": 1.0, "noise": 40.0},
            "got an unexpected keyword argument 'noise'",
        ),
    ],
)
def test_a_study_tells_its_options(options: dict[str, float], told: str) -> None:
    with pytest.raises(CaseError, match=f"modulate: {told}; the options are pump_frequency, pump"):
        df.modulate("embedded", **options)
