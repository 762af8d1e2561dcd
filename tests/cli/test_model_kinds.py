"""Every command follows `model.kind` or refuses it."""

from __future__ import annotations

import inspect
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import delam_fem as df
from delam_fem.api import assemble, reduced_case
from delam_fem.cli.app import app, commands
from delam_fem.studies.linear import first_frequencies, linear_amplitudes

COARSE = ("--set", "mesh.elements=3")
FOLLOW = {
    "run", "modes", "orbit find", "orbit follow", "reduce", "identify resonance",
    "identify keys", "identify natural", "detect excite", "detect pod", "detect infer",
}  # fmt: skip
"""Commands that compute whatever model a case has."""
REFUSE = {"compare", "show operators", "converge", "detect scan", "detect modulate", "detect tap"}
"""Commands that cannot, at least in a part of what they do."""


def test_each_command_that_takes_a_case_has_been_decided() -> None:
    taking = {
        name
        for group in commands().values()
        for name, function in group.items()
        if "case_name" in inspect.signature(function).parameters
    }
    assert taking == FOLLOW | REFUSE


@pytest.mark.parametrize(
    ("arguments", "kind", "study"),
    [
        (("compare", "default"), "plane-stress", "compare"),
        (("show", "operators", "default", "-o", "a.npz"), "solid", "operators"),
    ],
)
def test_a_model_that_a_study_does_not_follow_is_refused(
    arguments: tuple[str, ...], kind: str, study: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, [*arguments, *COARSE, "--set", f"model.kind={kind}"])
    assert result.exit_code == 2
    assert f'model.kind: {study}: expected "beam"' in result.stderr
    assert f'given "{kind}": ' in result.stderr
    assert not list(tmp_path.glob("runs/*")) and not (tmp_path / "a.npz").exists()


def test_a_reduced_model_gives_its_own_operators_and_modes(tmp_path: Path) -> None:
    small = df.preset("default", {"mesh.elements": 6})
    reduced_case(small, 6).save(tmp_path)
    case = str(tmp_path / "case.toml")
    status = CliRunner().invoke(app, ["show", "operators", case, "-o", str(tmp_path / "o.npz")])
    assert status.exit_code == 0, status.stderr
    with np.load(tmp_path / "o.npz") as arrays:
        assert np.all(arrays["M"] == np.eye(len(arrays["M"]))) and np.all(arrays["lamina"] == -1)
        lowest = np.sqrt(np.linalg.eigvalsh(arrays["K"])[0])
    assert lowest == pytest.approx(min(first_frequencies(small)), rel=1e-4)
    loaded_case, full = df.load_case(case), df.modes(small, 3, delaminations="closed")
    reduced = df.modes(loaded_case, 3, delaminations="closed")
    assert reduced.structure is not None and full.structure is not None
    # the reduced one ties gaps alone, not slopes
    assert reduced.structure.frequencies[0] == pytest.approx(full.structure.frequencies[0], rel=0.1)


def test_the_motion_without_contact_is_that_of_the_model() -> None:
    few = {"mesh.elements": 3, "excitation.frequency": 1.3}
    plane = df.preset("default", {**few, "model.kind": "plane-stress", "model.poisson": 0.3})
    beam = df.preset("default", few)
    modes = df.modes(plane, 1)
    assert first_frequencies(plane) == pytest.approx(2 * np.pi * modes.frequencies[:, 0])
    at = np.array([1.3])
    assert assemble(plane).operators.n_dofs == 72
    ratio = linear_amplitudes(plane, at) / linear_amplitudes(beam, at)
    assert np.all(np.abs(ratio - 1.0) > 1e-3) and np.all(np.abs(ratio - 1.0) < 0.5)


def test_the_intact_structure_of_a_reduced_model_is_refused(tmp_path: Path) -> None:
    reduced_case(df.preset("embedded", {"mesh.elements": 20}), 6).save(tmp_path)
    result = CliRunner().invoke(
        app, ["detect", "scan", str(tmp_path / "case.toml"), "-o", str(tmp_path / "d")]
    )
    assert result.exit_code == 2
    assert 'model.kind: detect: expected "beam"' in result.stderr
    case = str(tmp_path / "case.toml")
    result = CliRunner().invoke(app, ["converge", case, "--in", "elements"])
    assert result.exit_code == 2
    assert 'given "modes": ' in result.stderr
