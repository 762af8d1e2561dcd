"""Trials: errors of ways to step through contact, and the script that writes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from project import script
from refinements.document import write_csv
from trials import compare as trials
from trials.runners import runners


def test_errors_of_trials_are_relative_to_the_amplitude() -> None:
    limit = np.array([[-0.02, 0.0], [0.02, 0.03]])
    methods = {"way": trials.Found({1000: limit + np.array([[0.0, 0.0], [0.0, 0.0015]])})}
    assert trials.table(methods, limit).rows == (("way", "-20.00", "10.0"),)


@pytest.mark.nightly
def test_trials_in_a_short_form(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("penetration recovered without work", "newton@moreau-jean")
    chosen = {name: runners()[name] for name in names}
    monkeypatch.setattr(trials, "runners", lambda: chosen)
    methods, limit = trials.measure((500,), 8000, 40, 1)
    assert limit[:, 0] == pytest.approx([-0.020, 0.015], abs=0.002)
    errors = {name: one.error(500, limit) for name, one in methods.items()}
    assert errors["penetration recovered without work"] < 0.5 * errors["newton@moreau-jean"]
    figure = trials.figure(trials.errors_of(methods, limit))
    assert len(figure.axes[0].lines) == 2


def test_no_two_methods_of_a_panel_share_a_colour() -> None:
    errors = {f"way {k}": {1000: 1.0 + k, 4000: 1.0} for k in range(20)}
    figure = trials.figure(errors)
    named = [
        [line for line in panel.lines if not line.get_label().startswith("_")]
        for panel in figure.axes
    ]
    assert [line.get_label() for panel in named for line in panel] == list(errors)
    for panel, lines in zip(figure.axes, named, strict=True):
        assert len({line.get_color() for line in lines}) == len(lines)
        assert len(panel.lines) == 20 and panel.get_xlabel()


def test_the_figure_is_redrawn_from_the_table(tmp_path: Path) -> None:
    limit = np.array([[-0.02, 0.0], [0.02, 0.03]])
    methods = {"way": trials.Found({1000: 1.1 * limit, 4000: 1.05 * limit})}
    write_csv(tmp_path / "trials.csv", trials.table(methods, limit))
    assert trials.errors_in(tmp_path / "trials.csv") == {"way": {1000: 20.0, 4000: 10.0}}


def test_the_script_writes_table_and_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    contact_trials = script("contact_trials")
    table, picture = tmp_path / "trials.csv", tmp_path / "trials.png"
    limit = np.array([[-0.02, 0.0], [0.02, 0.03]])

    def measure(
        steps: tuple[int, ...], *settings: object
    ) -> tuple[dict[str, trials.Found], object]:
        assert settings == (256_000, 8, 1)
        return {"way": trials.Found({n: 1.1 * limit for n in steps})}, limit

    monkeypatch.setattr(contact_trials, "measure", measure)
    monkeypatch.setattr(contact_trials, "TABLE", table)
    monkeypatch.setattr(contact_trials, "FIGURE", picture)
    assert contact_trials.main(["--periods", "8", "--workers", "1"]) == 0
    row = "| way | -22.00 | -22.00 | -22.00 | 20.0 | 20.0 | 20.0 |"
    assert row in capsys.readouterr().out
    assert table.read_text("utf-8").endswith("\nway,-22.00,-22.00,-22.00,20.0,20.0,20.0\n")
    assert picture.stat().st_size > 10_000
