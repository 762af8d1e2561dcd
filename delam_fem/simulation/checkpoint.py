"""Save and load checkpoints: one file from which a run continues bit for bit.

The file contains the state with the set of resting pairs, the rows of all periods and the records
of the window.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from delam_fem.case.atomic import atomic
from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.energy import Energies
from delam_fem.simulation.impacts import Columns, Jumps
from delam_fem.simulation.loop import Engine, State
from delam_fem.simulation.recorder import PeriodRecord, Recorder

_PERIOD_ARRAYS = ("strobe", "envelope", "ledger", "impulse")


def path_in(directory: Path) -> Path:
    """Return the path of the checkpoint in a folder."""
    return directory / "checkpoint.npz"


def save(
    path: Path, case: Case, engine: Engine, recorder: Recorder, *, writes: bool = True
) -> None:
    """Write a checkpoint after a closed period.

    The old file is replaced only when the new one is complete.

    Args:
        path: the file.
        case: the case that is computed; `load` compares it.
        engine: engine with the state; every rank must call, because the state is gathered.
        recorder: recorder with everything recorded so far.
        writes: whether this rank writes the file.
    """
    k, state = recorder.n_closed, engine.state()
    arrays: dict[str, Any] = {
        "case": np.array(case.to_toml()),
        "n_closed": k,
        "motion": state.motion,
        "resting": state.resting,
        "losses": state.losses,
    }
    arrays |= {name: getattr(recorder, name)[:k] for name in _PERIOD_ARRAYS}
    for j, record in enumerate(recorder.window):
        arrays |= {f"window_{j}_{name}": values for name, values in _flatten(record).items()}
    if not writes:
        return
    with atomic(path) as temporary:
        np.savez(temporary, **arrays)


def load(
    path: Path | None,
    case: Case,
    engine: Engine,
    recorder: Recorder,
    motion: Callable[[int], FloatArray],
) -> None:
    """Restore an engine and a recorder from a checkpoint.

    Args:
        path: the file; None if the run has no folder.
        case: the case that is computed.
        engine: engine that receives the state.
        recorder: recorder that receives the rows and the window.
        motion: states of the base in a period; see `simulate`.

    Raises:
        CaseError: there is no checkpoint, or it belongs to another case.
    """
    if path is None:
        raise CaseError("resume: expected the directory of the interrupted run, given none")
    if not path.is_file():
        raise CaseError(f"resume: expected a checkpoint of an interrupted run, no file {path}")
    with np.load(path) as data:
        if str(data["case"]) != case.to_toml():
            raise CaseError(
                f"resume: {path} belongs to another case; run with the settings of the "
                "interrupted run, or without --resume"
            )
        damping, contact = (float(loss) for loss in data["losses"])
        k = recorder.n_closed = int(data["n_closed"])
        state = State(data["motion"], data["resting"], (damping, contact))
        engine.restore(state, motion(k)[0])
        for name in _PERIOD_ARRAYS:
            getattr(recorder, name)[:k] = data[name]
        for j in range(min(k, recorder.window.maxlen or k)):
            prefix = f"window_{j}_"
            names = [name for name in data.files if name.startswith(prefix)]
            recorder.window.append(_rebuild({n.removeprefix(prefix): data[n] for n in names}))


def _flatten(record: PeriodRecord) -> dict[str, Any]:
    """Return the record of a period as arrays by name."""
    energies, dissipated, contact_damped = record.start
    stored = [energies.kinetic, energies.strain, energies.spring, energies.momentum]
    return {
        "base_states": record.base_states,
        "u": record.u,
        "v": record.v,
        "frame_steps": record.frame_steps,
        "start": [*stored, dissipated, contact_damped],
        "frames": np.array(record.frames),
        "contact": np.array(record.contact, dtype=np.int8),
        "totals": [record.released, record.impact, record.n_steps],
        **{f"jump_{k}": column for k, column in record.jumps.columns()._asdict().items()},
    }


def _rebuild(arrays: dict[str, Any]) -> PeriodRecord:
    """Return the record of a period from the arrays that `_flatten` made."""
    start = [float(x) for x in arrays["start"]]
    released, impact, n_steps = (float(x) for x in arrays["totals"])
    columns = Columns(*(arrays[f"jump_{name}"] for name in Columns._fields))
    return PeriodRecord(
        arrays["base_states"],
        arrays["u"],
        arrays["v"],
        arrays["frame_steps"],
        (Energies(*start[:4]), start[4], start[5]),
        list(arrays["frames"]),
        list(arrays["contact"]),
        Jumps(columns),
        released,
        impact,
        int(n_steps),
    )
