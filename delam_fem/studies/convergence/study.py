"""Define the ladders from which docs/convergence.md is made."""

from __future__ import annotations

from delam_fem.case.definition import Case
from delam_fem.case.files import preset
from delam_fem.studies.convergence.ladder import Ladder, Method, method

MESHES = (10, 20, 40, 80, 160)
FEW = (1000, 4000, 16000, 64000, 256000)
"""Numbers of steps per period, from practical to very small steps."""
LAST = FEW[-1]
"""Steps per period of the rigid limit."""
DAMPINGS = ("stiffness", "two-mode")
FREQUENCIES = (1.25, 1.60, 3.25, 3.65)
RESTITUTIONS = (0.1, 0.0, 0.5)
STIFFNESSES = (1e2, 1e3, 1e4, 1e5)
REFINED = "newton@moreau-jean:64"
"""Method of the preset `default`."""
LAWS = tuple(method(law) for law in ("newton", "newton-penalty", "newton@moreau-jean", REFINED))
LITERAL = tuple(method(f"{law}/lumped") for law in ("newton", "newton-penalty"))
"""Methods of the paper taken literally: Newmark with lumped impulses."""
LITERAL_PERIODS = 300
"""Number of periods that suffice to show whether a motion grows."""


def case(damping: str, **keys: object) -> Case:
    """Return the preset `default` with a damping model and other changes."""
    return preset("default", {"damping.rayleigh": damping, **keys})


def varied(law: str, label: str, **keys: object) -> Method:
    """Return the method of a law (with its scheme) with other contact parameters."""
    return Method(
        f"{law} {label}", (("contact.law", law), *((f"contact.{k}", v) for k, v in keys.items()))
    )


def ladders() -> dict[str, Ladder]:
    """Return all ladders by name."""
    steps = (250, 500, 1000, 2000, 4000, 8000, 16000, 64000)
    found = {
        damping: Ladder(case(damping), LAWS, MESHES, steps, limit_steps=LAST)
        for damping in DAMPINGS
    }
    springs = (
        varied(law, f"k = {k:g} N/m", penalty_stiffness=k)
        for law in ("newton-penalty@newmark", "penalty@newmark")
        for k in STIFFNESSES
    )
    found["laws"] = Ladder(case("stiffness"), (*LAWS, *springs), (20,), FEW, limit_steps=LAST)
    rigid = tuple(varied("newton@moreau-jean", f"e = {e:g}", restitution=e) for e in RESTITUTIONS)
    both = (*rigid, method(REFINED))
    for f in FREQUENCIES:
        base = case("two-mode", **{"excitation.frequency": f})
        found[f"{f:.2f} Hz"] = Ladder(base, both, (20,), (1000, 2000, *FEW[1:]), limit_steps=LAST)
    found["restitution"] = Ladder(case("stiffness"), rigid, (20,), FEW, limit_steps=0)
    for damping in ("mass", *DAMPINGS):
        found[f"literal {damping}"] = Ladder(
            case(damping), LITERAL, MESHES, (1000, 4000), LITERAL_PERIODS, limit_steps=0
        )
    return found
