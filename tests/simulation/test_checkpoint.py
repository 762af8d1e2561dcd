"""A checkpoint that is damaged, or of another run, is bad input with one clear message."""

from __future__ import annotations

import json
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest
from scripted import Engine, motion, recorder
from support import refusal

import delam_fem as df
from delam_fem.api import identity, read_arrays, write_arrays
from delam_fem.simulation import checkpoint
from delam_fem.simulation.loop import simulate
from delam_fem.system.files import claimed

KEYS = {
    "mesh.elements": 3, "time.steps_per_period": 20, "time.periods": 4,
    "output.window_periods": 2, "output.fields_per_period": 0,
}  # fmt: skip
SEED, DAMAGES = 5, 60


def of_run() -> str:
    """Return the identity of a run of the case by a scripted engine."""
    return checkpoint.identity_of(case(), "compiled", Engine())


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
    complete_history = df.run(case()).history
    refused = 0
    for k in range(DAMAGES):
        content = bytearray(saved)
        if k % 3 == 0:
            del content[int(rng.integers(len(content))) :]
        else:
            for place in rng.integers(len(content), size=1 + k % 5):
                content[place] ^= int(rng.integers(1, 256))
        try:
            assert resumed(tmp_path, bytes(content)).history.equals(complete_history)
        except df.CaseError as error:
            refused += 1
            assert "damaged" in str(error) or "belongs to another" in str(error)
            assert len(str(error).splitlines()) == 1
    assert refused > DAMAGES // 2


def test_an_undamaged_one_is_not(saved: bytes, tmp_path: Path) -> None:
    assert resumed(tmp_path, saved).summary["outcome"] == "completed"


def test_another_version_is_refused(saved: bytes, tmp_path: Path) -> None:
    path = checkpoint.path_in(tmp_path)
    path.write_bytes(saved)
    arrays = read_arrays(path)
    content = json.loads(str(arrays["identity"]))
    content["question"]["version"] = "0.0.1"
    write_arrays(path, {**arrays, "identity": json.dumps(content)})
    with pytest.raises(df.CaseError, match=r'version: "0\.0\.1" there'):
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
    assert "checkpoint.npz: expected none" in caplog.text
    assert "the run goes on without it" in caplog.text


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
    complete_run = df.run(refined, engine=engine)
    stopped = df.run(
        refined, directory=tmp_path, engine=engine,
        progress=lambda k, n: signal.raise_signal(signal.SIGINT) if k == 10 else None,
    )  # fmt: skip
    assert stopped.summary["outcome"] == "interrupted" and stopped.history.sizes["period"] == 10
    again = df.run(refined, directory=tmp_path, engine=engine, resume=True)
    assert again.history.equals(complete_run.history)
    timing = {"wall_seconds": None, "microseconds_per_step": None}
    assert again.summary | timing == complete_run.summary | timing
    assert complete_run.summary["steps"] > 24 * 40  # some are divided


def test_of_a_long_error_the_first_line_is_told(tmp_path: Path) -> None:
    told = str(checkpoint._damaged(tmp_path / "c", ValueError("what is wrong\nwhere")))
    assert "(what is wrong)" in told and "where)" not in told
    assert "(ValueError)" in str(checkpoint._damaged(tmp_path / "c", ValueError()))


def test_a_checkpoint_gives_engine_and_recorder_back(tmp_path: Path) -> None:
    """After two of three periods, of which the window keeps both."""
    run_recorder, engine = recorder(window=2, frames=2), Engine()
    simulate(engine, run_recorder, motion, stop=lambda k: k == 2)
    arrays = checkpoint.arrays_of(of_run(), engine, run_recorder, "running")
    path = tmp_path / "c.npz"
    write_arrays(path, arrays)
    again, other = recorder(window=2, frames=2), Engine()
    outcome = checkpoint.load(path, of_run(), other, again, motion)
    assert (outcome, again.n_closed) == ("running", 2)
    assert other.stepper.step == engine.stepper.step == 8
    assert other.stepper.dissipated == 4.0 and other.stepper.contact_damped == 2.0
    np.testing.assert_array_equal(other.base_state, motion(2)[0])
    same = checkpoint.arrays_of(of_run(), other, again, "running")
    assert same.keys() == arrays.keys()
    for name, values in arrays.items():
        np.testing.assert_array_equal(same[name], values, err_msg=name)
    simulate(engine, run_recorder, motion)
    assert simulate(other, again, motion) == "completed"
    np.testing.assert_array_equal(again.ledger, run_recorder.ledger)


def test_messages_of_checkpoints_are_exact(tmp_path: Path) -> None:
    run_recorder, engine = recorder(window=2), Engine()
    simulate(engine, run_recorder, motion, stop=lambda k: k == 2)
    arrays, path = checkpoint.arrays_of(of_run(), engine, run_recorder, "running"), tmp_path / "c"

    def loaded(name: str = "compiled", of: df.Case | None = None, **options: bool) -> object:
        run = checkpoint.identity_of(of or case(), name, engine)
        return checkpoint.load(path, run, Engine(), recorder(window=2), motion, **options)

    assert refusal(lambda: checkpoint.load(None, of_run(), engine, run_recorder, motion)) == (
        "resume: expected the directory of the interrupted run, given none"
    )
    told = f"resume: expected a checkpoint of an interrupted run, no file {path}"
    assert refusal(loaded) == told
    write_arrays(path, arrays)
    assert loaded() == "running"
    assert 'engine: "compiled" there, "petsc" here' in refusal(lambda: loaded("petsc"))
    longer = case(**{"time.periods": 9})
    assert "time.periods: 4 there, 9 here" in refusal(lambda: loaded(of=longer))
    assert loaded(of=longer, of_shorter=True) == "running"
    finer = case(**{"mesh.elements": 4, "time.periods": 9})
    told = refusal(lambda: loaded(of=finer, of_shorter=True))
    assert "mesh.elements: 3 there, 4 here" in told and "periods" not in told
    damaged = (
        f"checkpoint: {path} is damaged or no checkpoint ({{}}); run without --resume or --extend "
        "to compute everything again, with --overwrite in the same folder"
    )
    for change, reason in (
        ({"n_closed": 4}, "another number of periods"),
        ({"n_closed": 0}, "another number of periods"),
        ({"motion": np.zeros((3, 4))}, "motion of another size or type"),
        ({"resting": np.zeros(3, bool)}, "resting of another size or type"),
    ):  # fmt: skip
        write_arrays(path, arrays | change)
        assert refusal(loaded) == damaged.format(reason)
    without = {key: array for key, array in arrays.items() if key != "identity"}
    write_arrays(path, without)
    assert refusal(loaded) == damaged.format("'identity'")
    write_arrays(path, {key: array for key, array in arrays.items() if key != "losses"})
    assert refusal(loaded) == damaged.format("'losses'")


def test_names_and_periods_are_read_from_files(tmp_path: Path) -> None:
    path = checkpoint.final_in(tmp_path)
    assert (path.name, checkpoint.path_in(tmp_path).name) == ("state.npz", "checkpoint.npz")
    assert checkpoint.engine_in(path) is None
    assert refusal(lambda: checkpoint.periods_in(path)) == (
        f"extend: expected the final state of a completed run, no file {path}; compute the case "
        "again with more periods"
    )
    write_arrays(path, {"identity": identity(case(), engine="petsc"), "n_closed": 7})
    assert checkpoint.engine_in(path) == "petsc" and checkpoint.periods_in(path) == 7
    write_arrays(path, {"other": 1})
    assert "'n_closed'" in refusal(lambda: checkpoint.periods_in(path))
    assert checkpoint.engine_in(path) is None


def test_the_folder_of_a_study_is_kept_while_it_is_not_complete(tmp_path: Path) -> None:
    folder, run_identity = tmp_path / "checkpoints", identity(case())
    with (
        pytest.raises(ValueError),
        checkpoint.of_study(tmp_path, run_identity, resume=False) as study_folder,
    ):
        assert study_folder == folder
        raise ValueError
    assert not folder.exists()  # nothing was in it
    with pytest.raises(ValueError), checkpoint.of_study(tmp_path, run_identity, resume=False):
        (folder / "one.npz").touch()
        raise ValueError
    with pytest.raises(ValueError), checkpoint.of_study(tmp_path, run_identity, resume=True):
        assert (folder / "one.npz").exists()
        raise ValueError
    other = identity(case(**{"mesh.elements": 4}))
    with pytest.raises(df.CaseError, match=r"mesh.elements: 3 there, 4 here"):
        with checkpoint.of_study(tmp_path, other, resume=True):
            pass
    assert (folder / "one.npz").exists()
    with checkpoint.of_study(tmp_path, other, resume=False):
        assert not (folder / "one.npz").exists()
        (folder / "two.npz").touch()
    assert not folder.exists()


class Ranks:
    """A communicator of two ranks, of which the other has wishes of its own."""

    rank, size = 0, 2

    def __init__(self) -> None:
        self.others = 0

    def allreduce(self, own: int, _: object) -> int:
        return own | self.others


@pytest.mark.parametrize("comm", [SimpleNamespace(rank=0, size=1), Ranks()])
def test_a_watch_reports_saves_when_due_and_stops(
    comm: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, asked, said = [100.0], [False], list[tuple[int, int]]()
    monkeypatch.setattr(checkpoint.time, "monotonic", lambda: now[0])
    run_recorder, engine = recorder(window=2), Engine()
    simulate(engine, run_recorder, motion, stop=lambda k: k == 2)
    path = tmp_path / "c.npz"
    watch = checkpoint.Watch(
        path, (of_run(), engine, run_recorder), lambda: asked[0], comm,
        report=lambda *own: said.append(own), seconds=5.0,
    )  # fmt: skip
    now[0] = 105.0
    assert not watch(1) and not path.exists()
    now[0] = 105.1
    assert not watch(2) and path.exists()
    path.unlink()
    now[0] = 110.0
    assert not watch(3) and not path.exists()  # counted from the last one
    asked[0] = True
    assert watch(3) and not path.exists()
    asked[0] = False
    if comm.size == 2:
        comm.others = 1
        assert watch(3) and not path.exists()
        comm.others = 2
        assert not watch(3) and path.exists()
    assert said[:3] == [(1, 3), (2, 3), (3, 3)]
    for outcome, told in (("interrupted", "running"), ("completed", "completed")):
        watch.leave(outcome)  # type: ignore[arg-type]
        assert str(read_arrays(path)["outcome"]) == told
    silent = checkpoint.Watch(None, (of_run(), engine, run_recorder), lambda: True, comm)
    now[0] = 999.0
    assert silent(1) and len(list(tmp_path.iterdir())) == 1


@pytest.fixture
def answered() -> Iterator[None]:
    """Let all signals that stop have their default answer, also where nohup started the tests."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in checkpoint.STOPPING}
    yield
    for number, answer in before.items():
        signal.signal(number, answer)


@pytest.mark.usefixtures("answered")
def test_signals_are_caught_and_a_second_interrupt_ends_at_once() -> None:
    before = {number: signal.getsignal(number) for number in checkpoint.STOPPING}
    for number in checkpoint.STOPPING:
        with checkpoint.stop_signals() as is_stopped:
            assert not is_stopped()
            signal.raise_signal(number)
            assert is_stopped()
            signal.raise_signal(signal.SIGTERM)  # a second one of another kind is noted alone
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt), checkpoint.interruptible():
            signal.raise_signal(number)
    assert {number: signal.getsignal(number) for number in checkpoint.STOPPING} == before


def test_what_nohup_ignores_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with checkpoint.stop_signals() as is_stopped:
            signal.raise_signal(signal.SIGHUP)
            assert not is_stopped()
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
            signal.raise_signal(signal.SIGTERM)
            assert is_stopped()
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
