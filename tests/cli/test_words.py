"""What commands take, and what they say of cases, beside what is stored."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, get_type_hints

import golden
import numpy as np
import pytest
from kit import SWEEP, invoke
from measurements import recorded, write_csv
from scipy.signal import lfilter
from synthetic import small_case, synthetic_history

from delam_fem.case.files import save_case
from delam_fem.cli.app import GROUPS

pytestmark = pytest.mark.usefixtures("elsewhere")


def options_of(name: str, command: Callable[..., None]) -> Iterator[str]:
    """Yield the options of a command: names, limits, default, meaning."""
    hints = get_type_hints(command, include_extras=True)
    for own, parameter in signature(command).parameters.items():
        about: Any = hints[own].__metadata__[0] if hasattr(hints[own], "__metadata__") else None
        told = {"default": parameter.default} if parameter.default is not Parameter.empty else {}
        for what in ("param_decls", "min", "max", "metavar", "help"):
            told[what] = getattr(about, what, None)
        words = [f"{what} {value}" for what, value in told.items() if value not in (None, ())]
        yield f"{name} {own}: {', '.join(words)}"


def test_options_are_the_stored_ones(stored: Callable[..., None]) -> None:
    commands = {name: own for group in GROUPS.values() for name, own in group.items()}
    stored("\n".join(line for one in commands.items() for line in options_of(*one)))


@pytest.mark.parametrize("name", ["paper", "default", "embedded", "sweep.toml"])
def test_a_check_says_what_is_stored(name: str, stored: Callable[..., None]) -> None:
    Path("sweep.toml").write_text(SWEEP, "utf-8")
    stored(golden.spoken(invoke("check", name).output))


def test_a_reduction_says_what_is_stored(stored: Callable[..., None]) -> None:
    few = ("--set", "mesh.elements=6", "--set", "contact.impulse=consistent", "--modes", "4")
    stored(golden.spoken(invoke("reduce", "paper", *few, "-o", "out").output))


BLOW = [
    "time.step=1e-4", "time.duration=0.2", "excitation.kind=hammer", "excitation.lamina=thin",
    "excitation.position=0.3", "excitation.duration=0.004", "excitation.amplitude=9",
]  # fmt: skip
CHECKS: dict[str, tuple[str, ...]] = {
    "a blow": ("paper", *BLOW), "a window of a blow": ("paper", *BLOW, "output.window_periods=30"),
    "a short run": ("paper", "time.periods=4", "time.most_periods=9", "contact.law=none"),
    "a bonded beam": ("edge", "delamination.1.end=0.31", "support.start=pinned"),
    "a sweep": ("paper", "excitation.kind=sweep", "excitation.start_frequency=1",
                "excitation.end_frequency=4", "excitation.duration=9", "mesh.elements=7"),
}  # fmt: skip


def test_checks_of_other_cases_say_what_is_stored(stored: Callable[..., None]) -> None:
    told = []
    for name, (of, *keys) in CHECKS.items():
        words = [word for key in keys for word in ("--set", key)]
        found = invoke("check", of, *words)
        told += [f"# {name}: {found.exit_code}", golden.spoken(found.output)]
    stored("\n".join(told))


def test_measurements_say_what_is_stored(stored: Callable[..., None]) -> None:
    """Two modes under a random force; a decay of two modes."""
    rng, t = np.random.default_rng(3), np.arange(4000) / 200.0
    force = rng.normal(size=t.size)
    y = lfilter([0.0, 1.0], [1.0, -1.7, 0.98], force) + lfilter([0.5], [1.0, 0.6, 0.97], force)
    rows = np.array([t, force, y]).T
    np.savetxt("m.csv", rows, "%.9g", ",", header="time [s],force [N],y [mm]", comments="")
    decay = np.exp(-0.3 * t) * np.cos(60.0 * t) + 0.4 * np.exp(-0.2 * t) * np.cos(85.0 * t)
    noise = rng.normal(0.0, 2e-4, t.size)
    write_csv(Path("d.csv"), t, {"z": 0.01 * (decay + noise)})
    told = []
    for words in (
        ("read", "m.csv", "d.csv", "-o", "a"), ("response", "m.csv", "-o", "b", "--excitation",
         "force", "--segment", "2"), ("response", "d.csv", "-o", "c", "--free", "z", "5", "12",
         "--segment", "4"), ("response", "m.csv", "-o", "d", "--excitation", "force", "--poles",
         "5", "90"), ("response", "m.csv", "-o", "e", "--excitation", "force", "--poles", "40",
         "48"),
    ):  # fmt: skip
        found = invoke("measure", *words)
        told += [f"# {' '.join(words)}: {found.exit_code}", golden.spoken(found.output)]
    stored("\n".join(told))


def test_a_run_and_what_is_laid_over_it_say_what_is_stored(stored: Callable[..., None]) -> None:
    case = small_case()
    save_case(case, Path("run"))
    history = synthetic_history(case)
    history.to_netcdf("run/result.nc", engine="h5netcdf")
    t, (a, b) = recorded(history, period=case.period, start=14.4, noise=1e-4)
    write_csv(Path("m.csv"), t, {"tip thick": a, "tip thin": 1.5 * b})
    told = []
    for words in (("measure", "overlay", "m.csv", "run"), ("show", "export", "run", "--to", "csv"),
                  ("show", "page", "run"), ("show", "page", "nowhere")):  # fmt: skip
        found = invoke(*words)
        told += [f"# {' '.join(words)}: {found.exit_code}", golden.spoken(found.output)]
    stored("\n".join(told))
