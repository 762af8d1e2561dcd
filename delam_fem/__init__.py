"""Simulate two delaminated laminae that clap together under base motion, by finite elements.

    import delam_fem as df
    case = df.preset("paper", {"excitation.frequency": 3.65})
    result = df.run(case)

The code uses these letters of the mathematics (SI units and float64 everywhere):

    x, L            position from the clamp, length of a lamina [m]
    E, I, A, rho    Young's modulus [Pa], second moment [m4], section [m2], density [kg/m3]
    M, C, K         mass, damping and stiffness matrix of the free dofs
    m, c, k (_b)    columns of M, C and K that couple the free dofs to the base motion q_b
    u, v, a         displacement from the stress-free shape (fixed frame), velocity, acceleration
    q               displacement u at one point, in the paper's notation
    f, omega, T     frequency [Hz], angular frequency [rad/s], period of the excitation [s]
    dt, N           time step [s], steps per period
    beta, gamma     parameters of Newmark's scheme (the paper's alpha_N and beta_N): 1/4 and 1/2
    alpha, beta     coefficients of Rayleigh damping C = alpha M + beta K [1/s, s]
    D               damping ratio [-]
    g0, gap         gap at rest, gap g0 + u_2 - u_1 [m]; positive is open
    H               gap operator: gap = H u + g0, gap rate = H v
    W               H M^-1 H^T: gap rates of the pairs per unit impulse on the pairs [1/kg]
    p, lambda       contact impulse [N s], contact force [N]
    e               coefficient of restitution [-]

The public names below are loaded at their first use. `import delam_fem` alone is therefore fast and
does not import dolfinx.
"""

from __future__ import annotations

from importlib import import_module, metadata
from typing import TYPE_CHECKING

from delam_fem.system import imports as imports  # first: it guards the import of dolfinx

if TYPE_CHECKING:
    from delam_fem.case.definition import Case
    from delam_fem.case.excitation import HarmonicMotion, SweptMotion
    from delam_fem.case.files import PRESETS, load_case, preset, save_case
    from delam_fem.contact.decisions import Decision
    from delam_fem.contact.laws import LAWS, SCHEMES, Law, Scheme
    from delam_fem.model.operators import BaseCoupling, DistributedOperators, Gap, Operators
    from delam_fem.model.reduction import reduced_case
    from delam_fem.pipeline import rest, run
    from delam_fem.reference.compare import compare
    from delam_fem.results.export import operators
    from delam_fem.results.fields.animation import animate
    from delam_fem.results.folder import OperatorsResult, Result, load_result
    from delam_fem.results.record import read_record, write_record
    from delam_fem.simulation.loop import State
    from delam_fem.studies.convergence.run import converge
    from delam_fem.studies.detection.study import (
        DETECT as detect,
        EXCITE as excite,
        INFER as infer,
        MODULATE as modulate,
        POD as pod,
        TAP as tap,
    )
    from delam_fem.studies.diagrams import diagram
    from delam_fem.studies.identification.study import (
        IDENTIFY as identify,
        NATURAL as natural,
        RESONANCE as resonance,
    )
    from delam_fem.studies.models import compare_models
    from delam_fem.studies.modes.frequencies import modes
    from delam_fem.studies.orbits.follow import follow
    from delam_fem.studies.orbits.run import orbit
    from delam_fem.studies.signals.overlay import overlay
    from delam_fem.studies.signals.reading import read_measured
    from delam_fem.studies.sweeps.grid import Sweep, load_sweep
    from delam_fem.studies.sweeps.run import run_sweep
    from delam_fem.system.errors import CaseError

_HOMES = {
    "LAWS": "contact.laws",
    "PRESETS": "case.files",
    "SCHEMES": "contact.laws",
    "BaseCoupling": "model.operators",
    "Case": "case.definition",
    "CaseError": "system.errors",
    "Decision": "contact.decisions",
    "DistributedOperators": "model.operators",
    "Gap": "model.operators",
    "HarmonicMotion": "case.excitation",
    "Law": "contact.laws",
    "Operators": "model.operators",
    "OperatorsResult": "results.folder",
    "Result": "results.folder",
    "Scheme": "contact.laws",
    "State": "simulation.loop",
    "Sweep": "studies.sweeps.grid",
    "SweptMotion": "case.excitation",
    "animate": "results.fields.animation",
    "compare": "reference.compare",
    "compare_models": "studies.models",
    "converge": "studies.convergence.run",
    "diagram": "studies.diagrams",
    "follow": "studies.orbits.follow",
    "load_case": "case.files",
    "load_result": "results.folder",
    "load_sweep": "studies.sweeps.grid",
    "modes": "studies.modes.frequencies",
    "operators": "results.export",
    "orbit": "studies.orbits.run",
    "overlay": "studies.signals.overlay",
    "preset": "case.files",
    "read_measured": "studies.signals.reading",
    "read_record": "results.record",
    "reduced_case": "model.reduction",
    "rest": "pipeline",
    "run": "pipeline",
    "run_sweep": "studies.sweeps.run",
    "save_case": "case.files",
    "write_record": "results.record",
}
"""Module that defines each public name that is no study, relative to the package."""

__all__ = [
    "LAWS",
    "PRESETS",
    "SCHEMES",
    "BaseCoupling",
    "Case",
    "CaseError",
    "Decision",
    "DistributedOperators",
    "Gap",
    "HarmonicMotion",
    "Law",
    "Operators",
    "OperatorsResult",
    "Result",
    "Scheme",
    "State",
    "Sweep",
    "SweptMotion",
    "__version__",
    "animate",
    "compare",
    "compare_models",
    "converge",
    "detect",
    "diagram",
    "excite",
    "follow",
    "identify",
    "infer",
    "load_case",
    "load_result",
    "load_sweep",
    "modes",
    "modulate",
    "natural",
    "operators",
    "orbit",
    "overlay",
    "pod",
    "preset",
    "read_measured",
    "read_record",
    "reduced_case",
    "resonance",
    "rest",
    "run",
    "run_sweep",
    "save_case",
    "tap",
    "write_record",
]

try:
    __version__: str = metadata.version("delam_fem")
except metadata.PackageNotFoundError:  # the sources run without being installed
    __version__ = "0.1.0"


def __getattr__(name: str) -> object:
    """Import a public name, or a study that this or another package offers, at its first use."""
    value: object
    if name in _HOMES:
        value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    else:
        from delam_fem.plugins import discovery

        if name.startswith("_") or name not in discovery.homes():
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = discovery.study(name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
