"""Say which keys of a case a run does not read, whatever their values are.

A key that contradicts another is refused where the case is checked. A key without effect is not
refused, because one case is often computed with several laws, models and excitations; it is listed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from delam_fem.case.excitation import Excitation, MultisineExcitation, parts_of
from delam_fem.case.sections import Contact, Lamina, Model, OwnContact
from delam_fem.contact.laws import SCHEMES, combination

if TYPE_CHECKING:
    from delam_fem.case.definition import Case

OF_CONTACT = ("restitution", "stiffness", "damping", "threshold_velocity", "radius")
"""Keys of a contact that say what happens while it is closed."""


def idle_keys(case: Case) -> Iterator[tuple[str, str]]:
    """Yield the keys that a run of a case does not read, given or not.

    Yields:
        The table as overrides name it, as "lamina.thick" or "contact", and the key.
    """
    for lamina in case.lamina:
        yield from ((f"lamina.{lamina.name}", key) for key in _of_lamina(case, lamina))
    for section, keys in (
        ("contact", sorted(set(Contact.model_fields) - read_of_contact(case))),
        ("damping", ["rayleigh"] if case.is_of_points else []),
        ("model", sorted(set(Model.model_fields) - _read_of_model(case))),
        ("time", _of_time(case)),
    ):
        yield from ((section, key) for key in keys)
    drives = parts_of(case.excitation)
    for number, excitation in enumerate(drives, start=1):
        place = "excitation" if len(drives) == 1 else f"excitation.{number}"
        yield from ((place, key) for key in _of_excitation(excitation))
    for number, opening in enumerate(case.delamination, start=1):
        if not opening.opening:
            yield from ((f"delamination.{number}", key) for key in ("shape", "exponent"))
    for place, table in case.contacts:
        idle = set(OF_CONTACT) - read_of_entry(case, table)
        yield from ((place, key) for key in OF_CONTACT if key in idle and hasattr(table, key))
    for section, entries in (("stop", case.stop), ("impactor", case.impactor)):
        for number, entry in enumerate(entries, start=1):
            yield from ((f"{section}.{number}", key) for key in _of_striker(case, entry))
    for number, start in enumerate(case.initial, start=1):
        if start.shape != "mode":
            yield f"initial.{number}", "mode"
    for sensor in case.sensor:
        if not sensor.noise:
            yield f"sensor.{sensor.name}", "seed"


def has_pairs(case: Case) -> bool:
    """Return whether anything of a case may touch."""
    return bool(case.stop or case.impactor) or has_interfaces(case)


def has_interfaces(case: Case) -> bool:
    """Return whether laminae of a case may touch one another."""
    return case.gap is not None or bool(case.delamination)


def read_of_contact(case: Case) -> set[str]:
    """Return the keys of the section `contact` that have an effect.

    A number that all contacts have of their own has none.
    """
    reads = set(combination(case.contact.law, case.time.scheme).reads)
    if case.is_massless:
        reads = {"restitution"}
    rigid = [entry for _, entry in case.contacts if not is_elastic(case, entry)]
    if not rigid:
        reads -= {"impulse"}
    for key in ("restitution", "threshold_velocity"):
        if all(getattr(entry, key) is not None for entry in rigid):
            reads -= {key}
    if case.has_own_springs:
        reads -= {"penalty_stiffness", "penalty_damping"}
    if not has_pairs(case):
        reads = set()
    return {"law"} | reads | ({"points_per_element"} if has_interfaces(case) else set())


def is_elastic(case: Case, entry: OwnContact) -> bool:
    """Return whether a contact of a case is a spring while it is closed."""
    return case.contact.law == "penalty" or entry.elastic_by is not None


def read_of_entry(case: Case, entry: OwnContact) -> set[str]:
    """Return the keys of `OF_CONTACT` that have an effect on a contact of a case."""
    reads = combination(case.contact.law, case.time.scheme).reads
    if case.contact.law == "none":
        return set()
    if case.is_massless:
        return {"restitution"}
    if is_elastic(case, entry):
        return {"stiffness", "radius"} | (set() if entry.stiffness is None else {"damping"})
    numbers = {"restitution", "threshold_velocity"} & set(reads)
    return numbers | ({"stiffness"} if "penalty_stiffness" in reads else set())


def _of_lamina(case: Case, lamina: Lamina) -> Iterator[str]:
    """Yield the keys that a lamina may have and a run does not read."""
    if case.model.file is not None:  # they must be those of the reduced case
        return
    is_read_by_balls = any(
        impactor.radius and impactor.lamina == lamina.name for impactor in case.impactor
    )
    if lamina.is_point:
        yield from ("width", "thickness", "density", "bending_stiffness", "motion")
        if not is_read_by_balls:
            yield from ("material", "young_modulus")
        yield from ("angle", "plies")
    elif lamina.motion == "axial" and "young_modulus" in lamina.model_fields_set:
        yield "bending_stiffness"
    elif lamina.has_two_stiffnesses and not is_read_by_balls:
        yield "young_modulus"


def _of_excitation(excitation: Excitation) -> list[str]:
    """Return the keys of an excitation that have no effect."""
    if excitation.kind == "force" and excitation.is_periodic:
        return ["spacing"]
    if isinstance(excitation, MultisineExcitation) and excitation.phases == "schroeder":
        return [] if excitation.lines == "odd-random" else ["seed"]
    return []


def _of_time(case: Case) -> Iterator[str]:
    """Yield the keys of the section `time` that have no effect."""
    if not case.is_periodic:
        yield "periods"
    if case.time.periods != "settled":
        yield "most_periods"
    if not case.is_loaded:
        yield "begin"
    is_linear = case.contact.law == "none" or not has_pairs(case)
    if is_linear:
        yield "refine"
    if is_linear or case.time.refine == 1 or case.is_massless:
        yield "refine_velocity"
    numbers = () if case.is_massless else SCHEMES[case.time.scheme].numbers
    yield from (key for key in ("theta", "beta", "gamma") if key not in numbers)
    if case.is_massless:
        yield "scheme"


def _read_of_model(case: Case) -> set[str]:
    """Return the keys of the section `model` that have an effect."""
    has_balls = any(impactor.radius is not None for impactor in case.impactor)
    reads = set(case.model.reads)
    if all(lamina.orthotropic is not None for lamina in case.lamina):
        reads -= {"poisson"}  # their ratios are those of the material
    return reads | ({"poisson"} if has_balls else set())


def _of_striker(case: Case, own: object) -> Iterator[str]:
    """Yield the other keys of a stop or an impactor that have no effect."""
    has_spring = getattr(own, "spring", 1.0) or getattr(own, "spring_damping", 0.0)
    if case.excitation.acts_on == "force" or not has_spring:
        yield "on"
    if hasattr(own, "opening") and not own.opening:
        yield from ("shape", "exponent")
