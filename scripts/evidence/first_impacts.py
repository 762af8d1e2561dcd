"""Compute the first impacts of the four reference motions and store them for the tests.

    .venv/bin/python scripts/evidence/first_impacts.py [FILE]  # tests/data/first_impacts.npz

The stored file was computed with dolfinx 0.5.2, and the tests compare all other versions with it.
Run the script again only if the model itself changes.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

import delam_fem as df
from delam_fem.paper.runs import FREQUENCIES

IMPACTS = 20
"""Number of stored impacts, counted by pairs; all of them are in the first period."""
EVERY = 20
"""Number of steps between stored states; the states at impacts are stored as well."""
KEPT = Path(__file__).parents[2] / "tests" / "data" / "first_impacts.npz"


def first_impacts(frequency: float, **overrides: object) -> dict[str, npt.NDArray[np.generic]]:
    """Compute a reference motion from rest up to impact 20.

    Args:
        frequency: frequency of the base [Hz].
        overrides: keys of the case to change, with `__` for the dot.

    Returns:
        Arrays by name: step, node, velocity_before [m/s] and impulse [N s] of the impacts, each of
        shape (20,); displacement [m], shape (2 laminae, states, nodes), at the steps `state_step`.
    """
    changes = {key.replace("__", "."): value for key, value in overrides.items()}
    case = df.preset(
        "paper",
        {
            "excitation.frequency": frequency,
            "time.periods": 1,
            "output.window_periods": 1,
            "output.fields_per_period": 1000,  # every step
            **changes,
        },
    )
    history = df.run(case).history
    step = np.rint(history.event_time.to_numpy() / case.time_step).astype(np.int32)[:IMPACTS]
    frame_step = np.rint(history.frame.to_numpy() / case.time_step).astype(np.int32)
    is_kept = (frame_step <= step[-1]) & ((frame_step % EVERY == 0) | np.isin(frame_step, step))
    return {
        "step": step,
        "node": history.event_node.to_numpy()[:IMPACTS].astype(np.int32),
        "velocity_before": history.event_velocity_before.to_numpy()[:IMPACTS],
        "impulse": history.event_impulse.to_numpy()[:IMPACTS],
        "state_step": frame_step[is_kept],
        "displacement": history.displacement.to_numpy()[:, is_kept],
    }


def main(arguments: list[str]) -> int:
    """Compute all motions and write the file; return the exit status."""
    path = Path(arguments[0]) if arguments else KEPT
    arrays = {
        f"{frequency:.2f} {name}": values
        for frequency in FREQUENCIES
        for name, values in first_impacts(frequency).items()
    }
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
