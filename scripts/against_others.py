"""Compute cases that others published, and write docs/against_others.md.

    .venv/bin/python scripts/against_others.py [FILE]

The cases are files in docs/examples/others. Each row has their number, ours and the difference.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

import delam_fem as df
from delam_fem.system.files import atomic

ROOT = Path(__file__).parents[1]
CASES = Path("docs", "examples", "others")
PAGE = ROOT / "docs" / "against_others.md"
BAR = 1e-3
"""Largest difference from what others print, relative."""


@dataclass(frozen=True)
class Row:
    """A number of others beside ours."""

    what: str
    theirs: float
    ours: float
    command: str
    note: str = ""

    @property
    def difference(self) -> float:
        """Our number beside theirs, relative."""
        return self.ours / self.theirs - 1.0


def at(history: xr.Dataset, name: str, time: float) -> float:
    """Return what the reference probe of the first lamina does at a time."""
    step = np.abs(history["time"].to_numpy() - time).argmin()
    return float(history[name][0, step])


def cantilever(history: xr.Dataset) -> tuple[float, ...]:
    """Return displacement, velocity and kinetic energy of SDNL104."""
    return (
        at(history, "tip_displacement", 0.1315),
        at(history, "tip_velocity", 0.1566),
        float(history["energy_kinetic"][-1]),
    )


def wall(history: xr.Dataset) -> tuple[float, ...]:
    """Return force, duration, time of the second largest force and impulse of SDND101."""
    force, time = history["sensor_wall"].to_numpy(), history["time"].to_numpy()
    ends = np.flatnonzero(np.diff((force > 0.0).astype(int)) < 0)
    second = time > 2.0 * time[ends[0]]
    return (
        float(force.max()),
        float(time[ends[0]]),
        float(time[second][force[second].argmax()]),
        float(force[: ends[0] + 1].sum() * (time[1] - time[0])),
    )


TIMES = (0.05, 0.156, 0.25, 0.4, 0.5, 0.8, 0.9, 1.0)


def on_base(history: xr.Dataset) -> tuple[float, ...]:
    """Return the absolute displacements of SDND102, whose signs are turned."""
    return tuple(-at(history, "tip_displacement", time) for time in TIMES)


def farthest(history: xr.Dataset) -> tuple[float, ...]:
    """Return the largest distance of the rod's tip from its rest in the last periods [mm]."""
    return (1e3 * float(np.abs(history["tip_displacement"]).max()),)


ROD = {
    0.4: {0.985: 0.21688, 1.0: 0.27062, 1.01: 0.33437, 1.02: 0.40895},
    4.0: {0.985: 0.20493, 1.0: 0.21730, 1.01: 0.22797, 1.02: 0.24231},
}
"""Largest tip displacement [mm] by the stiffness of the stop over EA/L, and frequency over ω₁."""


@dataclass(frozen=True)
class Test:
    """A published case: its file, what is changed in it, what is read, and what they print."""

    title: str
    file: str
    read: Callable[[xr.Dataset], tuple[float, ...]]
    theirs: Mapping[str, float]
    changes: Mapping[str, object]
    note: str = ""

    def rows(self) -> Iterator[Row]:
        """Compute the case and yield its rows."""
        case = df.load_case(ROOT / CASES / self.file).with_overrides(self.changes)
        history = df.run(case, engine="compiled").history
        sets = "".join(f" --set {key}={value}" for key, value in self.changes.items())
        command = f"delam-fem run {CASES / self.file}{sets}"
        for (what, theirs), ours in zip(self.theirs.items(), self.read(history), strict=True):
            yield Row(what, theirs, ours, command, self.note)


_LIMIT = (-3.58004, -1.22116, -1.88702, -1.89841, -0.702140, -1.10186, -1.19072, -1.08558)
TESTS = (
    Test(
        "Code_Aster SDNL104: a cantilever that a step force pushes onto an elastic stop",
        "sdnl104.toml",
        cantilever,
        {
            "u at 0.1315 s [m]": -1.85356697e-6,
            "v at 0.1566 s [m/s]": -4.63289360e-3,
            "kinetic energy at 0.16 s [J]": 0.05140814,
        },
        {},
        "the same trapezium rule and step, 1e-4 s",
    ),
    Test(
        "Code_Aster SDND101: a mass strikes an elastic wall (exact)",
        "sdnd101.toml",
        wall,
        {
            "largest force [N]": 9950.0,
            "length of the contact [s]": 0.03126,
            "time of the second largest force [s]": 0.361,
            "impulse [N s]": 198.05,
        },
        {},
        "steps of 1e-5 s",
    ),
    Test(
        "Code_Aster SDND102: a mass on a moving base and a stop on the ground",
        "sdnd102.toml",
        on_base,
        {f"x at {t:g} s [m]": 1e-4 * x for t, x in zip(TIMES, _LIMIT, strict=True)},
        {},
        "their values for Δt → 0; steps of 2.5e-6 s",
    ),
    *(
        Test(
            "Vadcard, Batailly, Thouverez (2022): a driven rod that strikes an elastic stop",
            "rod.toml",
            farthest,
            {f"largest tip u at k = {k:g} EA/L, {ratio:g} ω₁ [mm]": u},
            {
                "stop.1.stiffness": round(k * 2.52e9, 3),
                "excitation.frequency": round(ratio * 62711.98 / (2.0 * np.pi), 4),
            },
            "theirs by harmonic balance; 400 periods of 1000 steps",
        )
        for k, of_ratio in ROD.items()
        for ratio, u in of_ratio.items()
    ),
)

HEAD = f"""# Beside what others computed

Written by `scripts/against_others.py`, which runs the case files of `{CASES}` as a user would.
Every difference is relative and below {BAR:g}; a test repeats them.

What cannot be said in a case file yet: two bars in one line with other supports (SDNL111), forces
at several points and tubes with shear (SDNL301). Not tried: SDNL105, SDND123, the folds of the rod.
The exact solutions of [the continuum](continuum.md)
and Siconos' bar are where they were.
"""


def page(found: Mapping[str, list[Row]]) -> str:
    """Return the page."""
    lines = [HEAD]
    for title, rows in found.items():
        commands = dict.fromkeys(row.command for row in rows)
        lines += [f"## {title}", "", *(f"`{command}`  " for command in commands)]
        lines += [f"({rows[0].note})", ""]
        lines += ["| what | theirs | ours | difference |", "|---|---|---|---|"]
        lines += [
            f"| {r.what} | {r.theirs:.7g} | {r.ours:.7g} | {r.difference:+.1e} |" for r in rows
        ]
        lines.append("")
    return "\n".join(lines)


def main() -> None:
    """Write the page."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else PAGE
    with atomic(path) as temporary:
        found: dict[str, list[Row]] = {}
        for test in TESTS:
            found.setdefault(test.title, []).extend(test.rows())
        temporary.write_text(page(found), "utf-8")


if __name__ == "__main__":
    main()
