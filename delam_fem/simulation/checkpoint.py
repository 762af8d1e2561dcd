"""End a run early without loss: catch the signals of the system, save and load checkpoints.

Ctrl-C (SIGINT), SIGTERM and a closed terminal (SIGHUP) end a run after the period it is in, or
after the block of periods that the compiled engine computes in one go. Until then a `Watch` writes
checkpoints at intervals and reports progress.

A checkpoint is one file from which a run continues bit for bit. The same file, under the name of
`final_in`, stays beside the results of a completed run, so that the run can be extended.

The file contains the state with the set of resting pairs, the rows of all periods and the records
of the window. The checkpoint of a run that has ended contains all that its result is made of. State
and frames of a run on several ranks are gathered; the first rank writes them.
"""

from __future__ import annotations

import json
import logging
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import metadata
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.identity import belong, identity, require_same
from delam_fem.numerics.types import FloatArray
from delam_fem.simulation.loop import Engine, Outcome, State
from delam_fem.simulation.recorder import (
    LEVEL,
    N_BASE,
    Columns,
    Jumps,
    PeriodRecord,
    Recorder,
)
from delam_fem.system.errors import CaseError, reason_of
from delam_fem.system.files import read_arrays, remove_kept, write_arrays

if TYPE_CHECKING:
    from delam_fem.system.mpi import MPI

CHECKPOINT_SECONDS = 30.0
"""Least time between two checkpoints [s]: little is lost in a crash, and little time is spent."""

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a run: Ctrl-C, a polite kill, a closed terminal."""

LENGTH = ("time.periods", "time.most_periods")
"""Keys of the length of a run, which an extension changes."""

_Handler = Callable[[int, FrameType | None], None]
_version = cache(metadata.version)
_log = logging.getLogger(__name__)


@contextmanager
def stop_signals() -> Iterator[Callable[[], bool]]:
    """Catch the signals of `STOPPING`, and yield a function that says whether one has arrived.

    A second Ctrl-C raises KeyboardInterrupt at once. Outside the main thread nothing is caught.
    """
    received: list[int] = []

    def note(number: int, frame: object) -> None:
        if received and number == signal.SIGINT:
            raise KeyboardInterrupt
        received.append(number)

    with _handled(note):
        yield lambda: bool(received)


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt on every signal of `STOPPING`."""

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    with _handled(interrupt):
        yield


@contextmanager
def _handled(handler: _Handler) -> Iterator[None]:
    """Let a function handle the signals of `STOPPING`; `nohup` keeps SIGHUP ignored."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    is_kept = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    numbers = [number for number in STOPPING if number != signal.SIGHUP or not is_kept]
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


Progress = Literal["running"] | Outcome
"""How far a run is: still running, or how it has ended."""


class Watch:
    """Callback after each block: reports progress, saves checkpoints, decides whether to stop."""

    def __init__(
        self,
        path: Path | None,
        of_run: tuple[str, Engine, Recorder],
        is_stopped: Callable[[], bool],
        comm: MPI.Intracomm,
        *,
        report: Callable[[int, int], None] | None = None,
        seconds: float = CHECKPOINT_SECONDS,
    ) -> None:
        """Store what is watched, and start the clock of the checkpoints.

        Args:
            path: file of the checkpoints; None: there are none.
            of_run: identity of the run, engine with the state, recorder; see `arrays_of`.
            is_stopped: function that says whether this process was asked to stop.
            comm: communicator whose ranks must decide the same; the first one writes.
            report: function that takes the numbers of finished and of all periods; None: nobody
                wants to know.
            seconds: least time between two checkpoints [s].
        """
        self._path = path
        self._of_run = of_run
        self._report = report
        self._is_stopped = is_stopped
        self._comm = comm
        self._seconds, self._last = seconds, time.monotonic()

    def __call__(self, period: int) -> bool:
        """Report a period, save a checkpoint if due, and return whether to stop.

        All ranks return the same.
        """
        if self._report is not None:
            self._report(period, self._of_run[-1].n_periods)
        is_due = time.monotonic() - self._last > self._seconds
        wishes = 2 * is_due + self._is_stopped()
        if self._comm.size > 1:
            from delam_fem.system.mpi import MPI

            wishes = self._comm.allreduce(wishes, MPI.BOR)
        if wishes & 2:
            self.save("running")
            self._last = time.monotonic()
        return bool(wishes & 1)

    def leave(self, outcome: Outcome) -> None:
        """Save the checkpoint of a run that has ended; it stays until the result is on the disk."""
        self.save("running" if outcome == "interrupted" else outcome)

    def save(self, progress: Progress) -> None:
        """Save a checkpoint (collective); if that fails, warn, because the run itself can go on.

        The old file is replaced only when the new one is complete and on the disk.
        """
        if self._path is None:
            return
        arrays = arrays_of(*self._of_run, progress)
        try:
            if self._comm.rank == 0:
                write_arrays(self._path, arrays)
        except OSError as error:
            _log.warning("%s: %s; the run goes on without it", error.filename, error.strerror)
        except CaseError as error:  # something else stands in its place
            _log.warning("%s; the run goes on without it", error)


_PERIOD_ARRAYS = ("strobe", "envelope", "ledger", "impulse", "effort", "works")


def path_in(directory: Path) -> Path:
    """Return the path of the checkpoint in a folder."""
    return directory / "checkpoint.npz"


def final_in(directory: Path) -> Path:
    """Return the path of the final state of a completed run in a folder."""
    return directory / "state.npz"


@contextmanager
def of_study(directory: Path, study: str, *, resume: bool) -> Iterator[Path]:
    """Yield the folder for the checkpoints of a study; it is removed when the study is complete.

    Args:
        directory: folder of the study.
        study: identity of the study, to which the checkpoints belong.
        resume: whether to go on with the checkpoints that are there.

    Raises:
        CaseError: the checkpoints there belong to another study.
    """
    folder = directory / "checkpoints"
    if not resume:
        remove_kept(folder)
    folder.mkdir(exist_ok=True)
    belong(folder, study)
    try:
        yield folder
    except BaseException:
        if not any(folder.rglob("*.npz")):  # nothing to go on with
            remove_kept(folder)
        raise
    remove_kept(folder)


def arrays_of(run: str, engine: Engine, recorder: Recorder, outcome: Progress) -> dict[str, Any]:
    """Return the arrays of a checkpoint after a closed period by name.

    Args:
        run: identity of the run, see `identity_of`; `load` compares it.
        engine: engine with the state; every rank must call, because the state is gathered.
        recorder: recorder with everything recorded so far.
        outcome: "running", or how the run has ended.
    """
    k = recorder.n_closed
    arrays: dict[str, Any] = {
        "identity": np.array(run),
        "outcome": np.array(outcome),
        "n_closed": k,
        **engine.state().arrays,
    }
    arrays |= {name: getattr(recorder, name)[:k] for name in _PERIOD_ARRAYS}
    for j, record in enumerate(recorder.window):
        flat = {
            "base_states": record.base_states,
            "u": record.u,
            "v": record.v,
            "frame_steps": record.frame_steps,
            "start": record.start,
            "contact": np.array(record.contact, dtype=np.int8),
            "resting": record.resting,
            "damped": record.damped,
            "totals": [record.released, record.impact, record.n_steps, record.ticks_per_step],
            "frames": engine.gather(np.array(record.frames)),
            **{f"jump_{k}": column for k, column in record.jumps.columns()._asdict().items()},
        }
        arrays |= {f"window_{j}_{name}": values for name, values in flat.items()}
    return arrays


def identity_of(case: Case, name: str, engine: Engine, **question: object) -> str:
    """Return the identity of a run, which must be the same for it to continue bit for bit.

    Args:
        case: the case that is computed.
        name: name of the engine.
        engine: the engine.
        **question: what else the run depends on; see `identity`.
    """
    return identity(
        case, version=_version("delam_fem"), engine=name, ranks=engine.n_shares, **question
    )


def load(
    path: Path | None,
    run: str,
    engine: Engine,
    recorder: Recorder,
    motion: Callable[[int], FloatArray],
    *,
    of_shorter: bool = False,
) -> Progress:
    """Restore an engine and a recorder from a checkpoint.

    Args:
        path: the file; None if the run has no folder.
        run: identity of the run that is computed, see `identity_of`.
        engine: engine that receives the state.
        recorder: recorder that receives the rows and the window.
        motion: states of the base in a period; see `simulate`.
        of_shorter: whether the file may belong to the same case with fewer periods.

    Returns:
        How the run has ended, or "running".

    Raises:
        CaseError: there is no checkpoint, it is damaged, or it belongs to another run.
    """
    if path is None:
        raise CaseError("resume: expected the directory of the interrupted run, given none")
    if not path.is_file():
        raise CaseError(f"resume: expected a checkpoint of an interrupted run, no file {path}")
    try:
        data = read_arrays(path)
        stored_identity = str(data["identity"])
    except (ValueError, KeyError) as error:
        raise _damaged(path, error) from None
    require_same(stored_identity, run, path, without=LENGTH if of_shorter else ())
    try:
        return _restored(data, engine, recorder, motion)
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise _damaged(path, error) from None


def engine_in(path: Path) -> str | None:
    """Return the name of the engine of a checkpoint; None if it cannot be read."""
    try:
        with path.open("rb") as file, np.load(file) as archive:
            return str(json.loads(str(archive["identity"]))["question"]["engine"])
    except Exception:  # `load` says what is wrong
        return None


def periods_in(path: Path) -> int:
    """Return the number of periods of the completed run whose final state a file holds.

    Raises:
        CaseError: there is no such file, or it is damaged.
    """
    if not path.is_file():
        raise CaseError(
            f"extend: expected the final state of a completed run, no file {path}; compute the "
            "case again with more periods"
        )
    try:
        return int(read_arrays(path)["n_closed"])
    except (ValueError, KeyError, TypeError) as error:
        raise _damaged(path, error) from None


def _damaged(path: Path, error: Exception) -> CaseError:
    """Return the error for a file that is not a whole checkpoint."""
    return CaseError(
        f"checkpoint: {path} is damaged or no checkpoint ({reason_of(error)}); run without "
        "--resume or --extend to compute everything again, with --overwrite in the same folder"
    )


def _require_fitting(data: Mapping[str, Any], present: State, recorder: Recorder) -> None:
    """Require that every array of a checkpoint has the shape and the type that a run gives it.

    Args:
        data: the arrays, by name.
        present: state of the engine, whose arrays have the shapes of those of the file.
        recorder: recorder of the run, still empty.

    Raises:
        ValueError: an array has another shape or type, or names pairs that do not exist.
        KeyError: one is missing.
    """
    if str(data["outcome"]) not in ("running", "completed", "diverged", "failed"):
        raise ValueError("no outcome")
    k = int(data["n_closed"])
    if not 0 < k <= recorder.n_periods:
        raise ValueError("another number of periods")
    n_pairs = present.resting.size
    rows = recorder.steps_per_period + 1
    shapes: dict[str, tuple[int, ...]] = {
        name: values.shape for name, values in present.arrays.items() if name != "internal"
    }
    shapes |= {name: getattr(recorder, name)[:k].shape for name in _PERIOD_ARRAYS}
    is_failed = str(data["outcome"]) == "failed"
    window = [f"window_{j}_" for j in range(min(k, recorder.window_periods))]
    for prefix in window:
        n_frames = n_planned = recorder.frame_steps.size
        if is_failed and prefix == window[-1]:  # frames after the failure are not there
            n_frames = min(n_frames, len(data[f"{prefix}contact"]))
        sizes = data[f"{prefix}jump_sizes"]
        n_hits = int(sizes.sum())
        if sizes.dtype.kind not in "iu" or sizes.min(initial=0) < 0:
            raise ValueError("impacts of a negative size")
        of_record: dict[str, tuple[int, ...]] = {
            "base_states": (rows, 3 + 3 * recorder.n_forces),
            "u": (rows, N_BASE + recorder.n_observed),
            "v": (rows, recorder.n_observed),
            "frame_steps": (n_planned,),
            "start": (len(LEVEL),),
            "contact": (n_frames, n_pairs) if n_frames else data[f"{prefix}contact"].shape,
            "resting": (n_pairs,),
            "damped": (n_pairs,) if data[f"{prefix}damped"].size else (0,),
            "totals": (4,),
            "frames": (n_frames, 2, present.motion.shape[1]) if n_frames else (0,),
        }
        columns = dict.fromkeys(Columns._fields[:3], (sizes.size,))
        columns |= dict.fromkeys(Columns._fields[3:], (n_hits,))
        of_record |= {f"jump_{name}": shape for name, shape in columns.items()}
        shapes |= {f"{prefix}{name}": shape for name, shape in of_record.items()}
    for name, shape in shapes.items():
        values = np.asarray(data[name])
        if values.shape != shape or values.dtype.kind not in "fiub":
            raise ValueError(f"{name} of another size or type")
    for prefix in window:
        hit = data[f"{prefix}jump_hit"]
        if hit.size and (hit.dtype.kind not in "iu" or not 0 <= hit.min() <= hit.max() < n_pairs):
            raise ValueError("impacts of pairs that do not exist")


def _restored(
    data: Mapping[str, Any],
    engine: Engine,
    recorder: Recorder,
    motion: Callable[[int], FloatArray],
) -> Progress:
    """Fill an engine and a recorder with the arrays of a checkpoint; return the outcome."""
    outcome: Progress = str(data["outcome"])  # type: ignore[assignment]
    _require_fitting(data, engine.state(), recorder)
    state = State.of(data)
    k = int(data["n_closed"])
    for name in _PERIOD_ARRAYS:
        getattr(recorder, name)[:k] = data[name]
    for j in range(min(k, recorder.window.maxlen or k)):
        prefix = f"window_{j}_"
        content = {n.removeprefix(prefix): v for n, v in data.items() if n.startswith(prefix)}
        released, impact, n_steps, ticks = (float(x) for x in content["totals"])
        record = PeriodRecord(
            content["base_states"],
            content["u"],
            content["v"],
            content["frame_steps"],
            content["start"],
            frames=[engine.scatter(frame) for frame in content["frames"]],
            contact=list(content["contact"]),
            jumps=Jumps(Columns(*(content[f"jump_{name}"] for name in Columns._fields))),
            released=released,
            impact=impact,
            n_steps=int(n_steps),
            ticks_per_step=int(ticks),
            resting=content["resting"],
            damped=content["damped"],
        )
        recorder.window.append(record)
    recorder.n_closed = k
    engine.restore(state, motion(min(k, recorder.n_periods - 1))[0])
    return outcome
