"""Compare ways to step through contact: errors against the rigid limit, for docs/convergence.md.

    .venv/bin/python scripts/contact_trials.py [--periods 160] [--workers 2]

Writes the table between `<!-- table trials -->` and `<!-- end -->` of the document and its figure.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import trial_schemes as ts
from convergence_document import fill
from matplotlib.figure import Figure

import delam_fem as df
from delam_fem.engines.compiled.engine import Compiled, law_of
from delam_fem.engines.compiled.system import Scheme
from delam_fem.model import closed_form
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.style import WIDTH, styled
from delam_fem.simulation.loop import set_initial, simulate
from delam_fem.simulation.recorder import N_BASE
from delam_fem.simulation.setup import motion_of, recorder_of
from delam_fem.studies.convergence.tables import Table, number

ROOT = Path(__file__).parents[1]
DOCUMENT = ROOT / "docs" / "convergence.md"
STEPS = (1000, 4000, 16000)
LIMIT_STEPS = 256_000
MEAN_PERIODS = 60
"""Last periods over which extremes are averaged."""
E = 0.1
PERIOD_OF_SPRING = 20
"""Steps in which a pair on a spring, scaled with the step, vibrates once."""

Runner = Callable[[df.Case, Operators], FloatArray]
"""From a case and its operators to the extremes of each period, shape (n_periods, 2, 2)."""


def by_engine(law: str, theta: float | None, case: df.Case, operators: Operators) -> FloatArray:
    """Run in compiled code: Newmark where θ is None."""
    dt = case.time_step
    scheme = Scheme.newmark(dt) if theta is None else Scheme.moreau_jean(dt, theta)
    engine = Compiled(operators, scheme, law_of(case.with_overrides({"contact.law": law})))
    recorder, motion = recorder_of(case, operators), motion_of(case)
    set_initial(engine, None, motion(0)[0])
    simulate(engine, recorder, motion)
    return recorder.envelope


def by_modes(law: str, modes: int, case: df.Case, operators: Operators) -> FloatArray:
    """Run with so many modes of each lamina in place of the nodes' displacements."""
    reduced, observed = modal(operators, modes)
    found = np.full((case.n_periods, 2, 2), np.nan)
    engine = Compiled(
        reduced,
        Scheme.moreau_jean(case.time_step),
        law_of(case.with_overrides({"contact.law": law})),
    )
    recorder, motion = recorder_of(case, reduced), motion_of(case)

    def collect(done: int) -> bool:  # the tips are sums of modes, which no recorder observes
        tips = recorder.window[-1].u[:, N_BASE:] @ observed.T
        found[done - 1] = tips.min(axis=0), tips.max(axis=0)
        return False

    set_initial(engine, None, motion(0)[0])
    simulate(engine, recorder, motion, stop=collect)
    return found


def by_scaled_springs(case: df.Case, operators: Operators) -> FloatArray:
    """Run newton-penalty with a spring by the mass of a pair and Δt, and γ by Δt."""
    h = case.lamina[0].length / case.mesh.elements
    reduced = 1.0 / sum(1.0 / (h * lamina.mass_per_length) for lamina in case.lamina)
    stiffness = reduced * (2 * np.pi / (PERIOD_OF_SPRING * case.time_step)) ** 2
    gamma = case.contact.threshold_velocity * STEPS[0] / case.time.steps_per_period
    keys = {"contact.penalty_stiffness": stiffness, "contact.threshold_velocity": gamma}
    return by_engine("newton-penalty", None, case.with_overrides(keys), operators)


def modal(o: Operators, modes: int) -> tuple[Operators, FloatArray]:
    """Return a problem in its lowest modes, and the tips by modes, shape (2, 2 modes)."""
    n = o.n_dofs // 2
    parts = []
    for lamina in (slice(0, n), slice(n, 2 * n)):
        K, M = (A.toarray()[lamina, lamina] for A in (o.stiffness, o.mass))
        parts.append(scipy.linalg.eigh(K, M)[1][:, :modes])
    Phi = scipy.linalg.block_diag(*parts)
    M, C, K = (sp.csr_matrix(Phi.T @ (A @ Phi)) for A in (o.mass, o.damping, o.stiffness))
    b = o.base
    base = BaseCoupling(Phi.T @ b.mass, Phi.T @ b.damping, Phi.T @ b.stiffness, b.corner)
    H = sp.csr_matrix(o.gap_matrix @ Phi)
    every = np.arange(2 * modes)
    return Operators(M, C, K, M.diagonal(), base, H, o.gap0, every), Phi[o.observed]


def densely(step: object, make: Callable[..., ts.Scheme], arguments: tuple[object, ...],
            case: df.Case, operators: Operators) -> FloatArray:  # fmt: skip
    """Run a scheme of trial_schemes.py."""
    matrices = make(ts.Problem.of(operators), case.time_step, *arguments)
    bases = motion_of(case)(0).copy()
    return np.asarray(
        ts.envelopes(step, matrices, bases, case.n_periods, operators.observed)  # type: ignore[no-untyped-call]
    )


def trials() -> dict[str, Runner]:
    """Return all ways by name; the first two are the package's."""
    found: dict[str, Runner] = {
        "moreau-recovery": partial(by_engine, "moreau-recovery", 0.5),
        "moreau": partial(by_engine, "moreau", 0.5),
        "newton": partial(by_engine, "newton", None),
    }
    for theta in (0.52, 0.6, 1.0):
        found[f"moreau, θ = {theta:g}"] = partial(by_engine, "moreau", theta)
    found["newton-penalty, k by m/Δt², γ by Δt"] = by_scaled_springs
    for n in (5, 10):
        for law in ("moreau", "moreau-recovery"):
            found[f"{law}, {n} modes of each lamina"] = partial(by_modes, law, n)
    found["exact linear motion, impulses at the end"] = partial(
        densely, ts.exact_step, ts.exact_matrices, (E, False)
    )
    found["exact linear motion, impulses spread over the step"] = partial(
        densely, ts.exact_step, ts.exact_matrices, (E, True)
    )
    for radius in (0.9, 0.5):
        found[f"non-smooth generalised-α, ρ∞ = {radius:g}"] = partial(
            densely, ts.alpha_step, ts.alpha_matrices, (E, radius)
        )
    for is_stabilised, name in ((False, "implicit"), (True, "implicit and stabilised")):
        found[f"Newmark, contact forces {name}"] = partial(
            densely, ts.implicit_step, ts.implicit_matrices, (is_stabilised,)
        )
    for law, name in (
        (ts.CLOSED, "moreau, contact at U <= 0"),
        (ts.END, "gaps closed by the end of the step (Stewart, Trinkle), e = 0"),
        (ts.RECOVERY, "recovery without the bound on work"),
    ):
        found[name] = partial(densely, ts.theta_step, ts.theta_matrices, (law, E))
    return found


@dataclass(frozen=True)
class Found:
    """Mean extremes of the tips by steps per period, shape (2, 2) [m]; nan where it diverged."""

    extremes: dict[int, FloatArray]

    def error(self, steps: int, limit: FloatArray) -> float:
        """Return the largest difference in half peak-to-peak displacements of the tip [-]."""
        half = 0.5 * (limit[1] - limit[0])
        return float((np.abs(self.extremes[steps] - limit) / half).max())


def case_of(steps: int, periods: int) -> df.Case:
    """Return the case that is compared: 3.25 Hz, 20 elements, stiffness damping."""
    keys = {"time.steps_per_period": steps, "time.periods": periods, "contact.restitution": E}
    return df.preset("default", {"damping.rayleigh": "stiffness", **keys})


def compute(name: str, steps: int, periods: int) -> FloatArray:
    """Return the mean extremes of a way."""
    case = case_of(steps, periods)
    with np.errstate(all="ignore"):
        rows = trials()[name](case, closed_form.assemble(case).operators)
        return np.asarray(rows[-min(MEAN_PERIODS, periods // 2) :].mean(axis=0))


def table(found: dict[str, Found], limit: FloatArray) -> Table:
    """Return smallest y1 and errors."""
    steps = list(next(iter(found.values())).extremes)
    heading = ["way", *(f"y1, N = {n} [mm]" for n in steps), *(f"error, {n} [%]" for n in steps)]
    rows = []
    for name, one in found.items():
        y1 = (number(1e3 * one.extremes[n][0, 0], ".2f") for n in steps)
        errors = (number(100.0 * one.error(n, limit), ".1f") for n in steps)
        rows.append((name, *y1, *errors))
    return Table("", tuple(heading), tuple(rows))


def figure(found: dict[str, Found], limit: FloatArray) -> Figure:
    """Draw errors over steps."""
    result = Figure(figsize=(WIDTH, 5.2), layout="constrained")
    axes = result.add_subplot(
        xscale="log",
        yscale="log",
        xlabel="steps per period [–]",
        ylabel="error of the extremes [%]",
    )
    colours = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
    for i, (name, one) in enumerate(found.items()):
        errors = [100.0 * one.error(n, limit) for n in one.extremes]
        line = ("-", "--", ":")[i // len(colours)]
        colour, marker = colours[i % len(colours)], "os^v"[i // len(colours)]
        width = 3.0 if i == 0 else 1.3
        axes.plot(list(one.extremes), errors, line + marker, color=colour, lw=width, label=name)
    axes.set_xticks(list(next(iter(found.values())).extremes))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:.0f}")
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    result.legend(loc="outside right center", fontsize=7)
    result.suptitle("3.25 Hz, 20 elements, stiffness damping, e = 0.1", fontsize=10)
    return result


def measure(steps: Sequence[int], limit_steps: int, periods: int, workers: int | None,
            ) -> tuple[dict[str, Found], FloatArray]:  # fmt: skip
    """Return what all ways give, and the rigid limit."""
    wanted = [("moreau", limit_steps), *((name, n) for name in trials() for n in reversed(steps))]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures = {key: pool.submit(compute, *key, periods) for key in wanted}
        results = {key: future.result() for key, future in futures.items()}
    found = {name: Found({n: results[name, n] for n in steps}) for name in trials()}
    return found, results["moreau", limit_steps]


def main(arguments: list[str] | None = None) -> int:
    """Compute, print and bring the document up to date; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--periods", type=int, default=160)
    parser.add_argument("--workers", type=int, default=None)
    given = parser.parse_args(arguments)
    found, limit = measure(STEPS, LIMIT_STEPS, given.periods, given.workers)
    shown = table(found, limit)
    sys.stdout.write(shown.markdown() + "\n")
    with styled():
        figure(found, limit).savefig(ROOT / "docs" / "figures" / "convergence_trials.png")
    DOCUMENT.write_text(fill(DOCUMENT.read_text("utf-8"), {"trials": shown}), "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
