"""Figures of channels: histories, spectra and portraits, a panel for each unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from synthetic import small_case, synthetic_history

from delam_fem.api import CaseError, Sensor
from delam_fem.results.figures import run as figures
from delam_fem.results.schema import with_sensor
from delam_fem.simulation.signals import Signal


@pytest.mark.usefixtures("pictures")
def test_each_sensor_has_a_panel_in_its_unit(tmp_path: Path) -> None:
    case = small_case()
    history = synthetic_history(case)
    assert "channels" not in figures.figures_of(history, case)
    strain = Sensor(name="e", quantity="strain", lamina="thin", position=0.0)
    slow = Sensor(name="v", quantity="velocity", lamina="thin", position=0.1, sampling_rate=50.0)
    time = history["time"].to_numpy()
    history = with_sensor(history, Signal(strain, time, 1e-4 * np.sin(time)))
    history = with_sensor(history, Signal(slow, time[::7], np.cos(time[::7])))
    figure = figures.figures_of(history, case)["channels"](history, case)
    first, second = figure.axes[:2]
    assert first.get_ylabel() == "strain [µm/m]" and second.get_ylabel() == "velocity [m/s]"
    np.testing.assert_allclose(first.lines[0].get_ydata()[-1], 100.0 * np.sin(time[-1]))
    names = [path.name for path in figures.save_figures(history, case, tmp_path)]
    assert "channels.png" in names


def test_spectra_and_portraits_of_any_channels() -> None:
    """The base moves by A sin ωt: one line at the drive, and an ellipse with the axes A, ωA."""
    case = small_case()
    history = synthetic_history(case)
    plots = figures.Plots(history, case)
    spectra = plots.channel_spectra("base", "tip_thin", "tip_thin_velocity")
    motions, velocities = spectra.axes[:2]
    assert motions.get_ylabel() == "amplitude of displacement [mm]"
    assert velocities.get_ylabel() == "amplitude of velocity [m/s]"
    orders, amplitudes = motions.lines[0].get_data()
    size = 1e3 * float(np.abs(history["base_displacement"]).max())
    assert amplitudes[np.argmin(np.abs(orders - 1.0))] == pytest.approx(size, rel=0.02)
    others = amplitudes[np.abs(orders - 1.0) > 1e-6]
    assert np.nanmax(others, initial=0.0) < 1e-9 * size and np.isnan(others).any()  # masked
    (decibels,) = (axes for axes in spectra.axes if axes.get_ylabel() == "dB re 1 mm")
    limits = 20.0 * np.log10(motions.get_ylim())
    np.testing.assert_allclose(decibels.get_ylim(), limits, rtol=1e-12)
    (portrait, *_) = plots.channel_portraits("base").axes
    q, rate = portrait.lines[0].get_data()
    omega = 2.0 * np.pi / case.period
    inner = slice(5, -5)
    size_of_rate = np.hypot(omega * q[inner], rate[inner])
    np.testing.assert_allclose(size_of_rate, omega * size, rtol=0.02)
    with pytest.raises(CaseError, match=r"expected some of tip_thick.*given laser"):
        plots.channels("laser")
