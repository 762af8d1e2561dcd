"""A checkpoint that is damaged, or of another run, is bad input with one clear message."""

from __future__ import annotations

import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

import delam_fem as df
from delam_fem.simulation import checkpoint
from delam_fem.system.files import claimed, read_arrays, write_arrays

KEYS = {
    "mesh.elements": 3, "time.steps_per_period": 20, "time.periods": 4,
    "output.window_periods": 2, "output.fields_per_period": 0,
}  # fmt: skip
SEED, DAMAGES = 5, 60


def case(**keys: object) -> df.Case:
    return df.preset("paper", KEYS | keys)


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return the content of a checkpoint after one period."""
    folder = tmp_path_factory.mktemp("run")
    df.run(case(), directory=folder, progress=lambda k, n: signal.raise_signal(signal.SIGINT))
    return checkpoint.path_in(folder).read_bytes()


def resumed(folder: Path, content: bytes) -> df.Result:
    """Resume from a checkpoint with a content."""
    checkpoint.path_in(folder).write_bytes(content)
    return df.run(case(), directory=folder, resume=True)


def test_damaged_checkpoints_are_refused_or_harmless(saved: bytes, tmp_path: Path) -> None:
    """Cut, overwritten and emptied files; a change that no checksum covers changes no number."""
    rng = np.random.default_rng(SEED)
    whole = df.run(case()).history
    refused = 0
    for k in range(DAMAGES):
        content = bytearray(saved)
        if k % 3 == 0:
            del content[int(rng.integers(len(content))) :]
        else:
            for place in rng.integers(len(content), size=1 + k % 5):
                content[place] ^= int(rng.integers(1, 256))
        try:
            assert resumed(tmp_path, bytes(content)).history.equals(whole)
        except df.CaseError as error:
            refused += 1
            assert "damaged" in str(error) or "is of" in str(error) or "another case" in str(error)
            assert len(str(error).splitlines()) == 1
    assert refused > DAMAGES // 2


def test_an_undamaged_one_is_not(saved: bytes, tmp_path: Path) -> None:
    assert resumed(tmp_path, saved).summary["outcome"] == "completed"


@pytest.mark.parametrize(("key", "value"), [("version", "0.0.1"), ("scheme", "moreau-jean")])
def test_another_version_or_scheme_is_refused(
    key: str, value: str, saved: bytes, tmp_path: Path
) -> None:
    path = checkpoint.path_in(tmp_path)
    path.write_bytes(saved)
    write_arrays(path, {**read_arrays(path), key: value})
    with pytest.raises(df.CaseError, match=f"is of {key} '{value}', expected"):
        df.run(case(), directory=tmp_path, resume=True)


def test_numbers_that_were_changed_are_refused(saved: bytes, tmp_path: Path) -> None:
    path = checkpoint.path_in(tmp_path)
    path.write_bytes(saved)
    with np.load(path) as data:
        arrays = {name: data[name] for name in data.files}
    np.savez(path, **{**arrays, "motion": 1.01 * arrays["motion"]})
    with pytest.raises(df.CaseError, match=r"damaged .*\(changed after it was written\)"):
        df.run(case(), directory=tmp_path, resume=True)


def test_a_folder_belongs_to_one_run(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as other, claimed(tmp_path):
        with pytest.raises(df.CaseError, match="another process is writing there"):
            other.submit(df.run, case(), directory=tmp_path).result()
        df.run(case(), directory=tmp_path)  # as the command that holds it does


def test_a_checkpoint_that_cannot_be_written_is_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    checkpoint.path_in(tmp_path).mkdir()  # in its place
    result = df.run(case(), directory=tmp_path, checkpoint_seconds=0.0, overwrite=True)
    assert result.summary["outcome"] == "completed"
    assert "checkpoint.npz: Is a directory; the run goes on" in caplog.text


def test_a_diverged_run_is_not_computed_on(tmp_path: Path) -> None:
    wild = case(**{"excitation.amplitude": 50.0, "contact.law": "none"})
    first = df.run(wild, directory=tmp_path)
    assert first.summary["outcome"] == "diverged"
    again = df.run(wild, directory=tmp_path, resume=True)
    assert again.summary["outcome"] == "diverged"
    assert again.history.equals(first.history)


@pytest.mark.parametrize("engine", ["compiled", "petsc"])
def test_a_window_across_the_checkpoint_has_the_same_numbers_with_divided_steps(
    tmp_path: Path, engine: Literal["compiled", "petsc"]
) -> None:
    """Marks of divided steps are not kept: the ledger, which reads them, is written before."""
    refined = case(**{
        "time.refine": 8, "time.steps_per_period": 40, "time.periods": 24,
        "output.window_periods": 20, "output.fields_per_period": 4, "excitation.frequency": 3.25,
    })  # fmt: skip
    whole = df.run(refined, engine=engine)
    stopped = df.run(
        refined, directory=tmp_path, engine=engine,
        progress=lambda k, n: signal.raise_signal(signal.SIGINT) if k == 10 else None,
    )  # fmt: skip
    assert stopped.summary["outcome"] == "interrupted" and stopped.history.sizes["period"] == 10
    again = df.run(refined, directory=tmp_path, engine=engine, resume=True)
    assert again.history.equals(whole.history)
    timing = {"wall_seconds": None, "microseconds_per_step": None}
    assert again.summary | timing == whole.summary | timing
    assert whole.summary["steps"] > 24 * 40  # some are divided


def test_of_a_long_error_the_first_line_is_told(tmp_path: Path) -> None:
    told = str(checkpoint._damaged(tmp_path / "c", ValueError("what is wrong\nwhere")))
    assert "(what is wrong)" in told and "where)" not in told
    assert "(ValueError)" in str(checkpoint._damaged(tmp_path / "c", ValueError()))
