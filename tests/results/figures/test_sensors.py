"""The figure of the sensors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from synthetic import small_case, synthetic_history

from delam_fem.api import Signal
from delam_fem.case.sections import Sensor
from delam_fem.results.figures import run as figures
from delam_fem.results.schema import with_sensor


@pytest.mark.usefixtures("pictures")
def test_each_sensor_has_a_panel_in_its_unit(tmp_path: Path) -> None:
    case = small_case()
    history = synthetic_history(case)
    assert "sensors" not in figures.figures_of(history)
    strain = Sensor(name="e", quantity="strain", lamina="thin", position=0.0)
    slow = Sensor(name="v", quantity="velocity", lamina="thin", position=0.1, sampling_rate=50.0)
    time = history["time"].to_numpy()
    history = with_sensor(history, Signal(strain, time, 1e-4 * np.sin(time)))
    history = with_sensor(history, Signal(slow, time[::7], np.cos(time[::7])))
    figure = figures.figures_of(history)["sensors"](history, case)
    first, second = figure.axes[:2]
    assert first.get_ylabel() == "[µm/m]" and second.get_ylabel() == "[m/s]"
    np.testing.assert_allclose(first.lines[0].get_ydata()[-1], 100.0 * np.sin(time[-1]))
    names = [path.name for path in figures.save_figures(history, case, tmp_path)]
    assert "sensors.png" in names
