"""The mass of a sensor is in the reduced structure, and no more in the case that is computed."""

from __future__ import annotations

from pathlib import Path

import pytest

import delam_fem as df
from delam_fem.api import assemble, lowest, reduced_case

SENSOR = {"name": "tip", "quantity": "acceleration", "lamina": "upper", "position": 0.2}
KEYS = {"model.kind": "plane-stress", "mesh.elements": 16, "contact.law": "none"}


def test_a_case_with_a_mounted_sensor_is_reduced_and_computed(tmp_path: Path) -> None:
    data = df.preset("embedded", KEYS).model_dump(mode="json", exclude_unset=True)
    case = df.Case(**data | {"sensor": [SENSOR | {"mass": 0.02}]})
    reduced_case(case, 5).save(tmp_path)
    operators = [assemble(one).operators for one in (case, df.load_case(tmp_path / "case.toml"))]
    full, reduced = (lowest(o.stiffness, o.mass, 3)[0] for o in operators)
    assert reduced == pytest.approx(full, rel=1e-6)
    bare = assemble(df.Case(**data)).operators
    assert reduced[0] < 0.95 * lowest(bare.stiffness, bare.mass, 1)[0][0]
