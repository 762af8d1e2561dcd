"""Define the refinement studies from which docs/evidence/convergence.md is made."""

from __future__ import annotations

from delam_fem.api import Case, preset
from delam_fem.studies.convergence.refinement import (
    MeshChoice,
    Method,
    PointMesh,
    RefinementStudy,
    method,
)

MESHES = (10, 20, 40, 80, 160)
"""Meshes with contact at their nodes."""
POINTS: dict[str, tuple[MeshChoice, ...]] = {
    "meshes": MESHES,
    "points": tuple(PointMesh(20, p) for p in (1, 2, 4, 8, 16)),
    "ten elements": tuple(PointMesh(10, p) for p in (1, 2, 4, 8)),
}
"""Meshes with contact at their nodes, and with contact points inside 20 and 10 elements."""
FEW = (1000, 4000, 16000, 64000, 256000)
"""Numbers of steps per period, from practical to very small steps."""
LAST = FEW[-1]
"""Steps per period of the rigid limit."""
DAMPINGS = ("stiffness", "two-mode")
FREQUENCIES = (1.25, 1.60, 3.25, 3.65)
RESTITUTIONS = (0.0, 0.1, 0.5, 0.9, 1.0)
STIFFNESSES = (1e2, 1e3, 1e4, 1e5)
PLAIN = method("newton@moreau-jean")
REFINEMENTS = (4, 16, 64, 256)
REFINED = {r: method(f"newton@moreau-jean:{r}") for r in (*REFINEMENTS, 1024, 4096)}
FINEST = {"meshes": (64, 256), "points": (1024, 4096), "ten elements": (64, 256)}
"""Refinements of the studies in the contact points, for the limit in time."""
_OF_DEFAULT = {"time.refine": 64, "time.refine_velocity": 0.02}
DEFAULT = Method("default", (*PLAIN.overrides, *_OF_DEFAULT.items()))
"""Method of the preset `default`, with DEFAULT_STEPS steps per period."""
DEFAULT_STEPS = 1000
LAWS = (method("newton@newmark"), method("newton-penalty@newmark"), PLAIN)
LITERAL = tuple(method(f"{law}/lumped") for law in ("newton", "newton-penalty"))
"""Methods of the paper taken literally: Newmark with lumped impulses."""
LITERAL_PERIODS = 300
"""Number of periods that suffice to show whether a motion grows."""
PETSC_PERIODS = 20
"""Number of periods in the statistics of the PETSc engine, which is slower."""


def case(damping: str, **keys: object) -> Case:
    """Return the preset `default` with a damping model and other changes.

    Pairs divide a step however slowly they move; only `DEFAULT` has the velocity of the preset.
    """
    return preset("default", {"damping.rayleigh": damping, "time.refine_velocity": 0.0, **keys})


def varied(law: str, label: str, **keys: object) -> Method:
    """Return the method of a law (with its scheme) with other contact parameters, not refined."""
    parameters = ((f"contact.{k}", v) for k, v in keys.items())
    return Method(f"{law} {label}", (("contact.law", law), ("time.refine", 1), *parameters))


def refinements() -> dict[str, RefinementStudy]:
    """Return all refinement studies by name."""
    result = {}
    refined = tuple(REFINED[r] for r in REFINEMENTS)
    springs = (
        varied(law, f"k = {k:g} N/m", penalty_stiffness=k)
        for law in ("newton-penalty@newmark", "penalty@newmark")
        for k in STIFFNESSES
    )
    result["laws"] = RefinementStudy(
        case("stiffness"), (LAWS[0], PLAIN, *springs), (20,), FEW, limit_steps=0
    )
    for damping in DAMPINGS:
        base = case(damping)
        result[f"uniform {damping}"] = RefinementStudy(base, (PLAIN,), (20,), FEW, limit_steps=0)
        result[f"errors {damping}"] = RefinementStudy(
            base, (*LAWS, *refined), (20,), (250, 500, 1000, 2000, 4000), limit_steps=LAST
        )
        result[f"petsc {damping}"] = RefinementStudy(
            base, (PLAIN, *refined), (20,), (1000,), PETSC_PERIODS, limit_steps=0, engine="petsc"
        )
        for name, meshes in POINTS.items():
            methods = tuple(REFINED[r] for r in FINEST[name])
            result[f"{name} {damping}"] = RefinementStudy(
                base, methods, meshes, (1000,), limit_steps=0
            )
        for f in FREQUENCIES:
            moved = case(damping, **{"excitation.frequency": f})
            result[f"{f:.2f} Hz {damping}"] = _with_default(moved)
        for e in RESTITUTIONS:
            bouncing = case(damping, **{"contact.restitution": e})
            result[f"e = {e:g} {damping}"] = _with_default(bouncing)
    for damping in ("mass", *DAMPINGS):
        result[f"literal {damping}"] = RefinementStudy(
            case(damping), LITERAL, MESHES, (1000, 4000), LITERAL_PERIODS, limit_steps=0
        )
    return result


def _with_default(case: Case) -> RefinementStudy:
    """Return the refinement study of the default and of plain steps, with the rigid limit."""
    return RefinementStudy(case, (PLAIN, DEFAULT), (20,), (DEFAULT_STEPS, 4000), limit_steps=LAST)
