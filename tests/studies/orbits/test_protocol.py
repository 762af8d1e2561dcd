"""What a map says of its states."""

import numpy as np

from delam_fem.studies.orbits.maps import MapInfo


def test_a_state_is_split_and_scaled_by_parts_of_one_unit() -> None:
    info = MapInfo("three parts", {"a": 2, "b": 1, "c": 3})
    state = np.array([1.0, -4.0, 0.0, 2e3, 0.0, -1e3])
    parts = info.split(state)
    assert {name: part.tolist() for name, part in parts.items()} == {
        "a": [1.0, -4.0], "b": [0.0], "c": [2e3, 0.0, -1e3],
    }  # fmt: skip
    np.testing.assert_array_equal(info.scales(state), [4.0, 4.0, 1.0, 2e3, 2e3, 2e3])
