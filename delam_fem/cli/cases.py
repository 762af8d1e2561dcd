"""Define the commands about cases: `new`, `check`, `reduce` and `show operators`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from delam_fem.cli.console import (
    CaseArgument,
    Folder,
    Overrides,
    Overwrite,
    OverwriteFile,
    Quiet,
    Rows,
    case_of,
    overrides_in,
    require_one,
    say,
    table,
)
from delam_fem.cli.endings import BAD_INPUT, tell
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    from delam_fem.case.definition import Case
    from delam_fem.case.sections import (
        Delamination,
        Impactor,
        Lamina,
        OwnContact,
        PointMass,
        PointSupport,
        Stop,
    )
    from delam_fem.engines.session import EngineName
    from delam_fem.model.reduction import Reduction
    from delam_fem.numerics.types import FloatArray
    from delam_fem.studies.sweeps.grid import Sweep


SUFFIX = ".toml"


def new_command(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="Name of the case, or of its file (default: beam)."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="Write this file (default: NAME.toml)."
        ),
    ] = None,
    *,
    kind: Annotated[
        Literal["apart", "paper", "layered", "edge"] | None,
        typer.Option(
            help="apart (the default): two laminae, clamped together at one end; paper: with the "
            "paper's literal law; layered: a bonded beam with a delamination inside; edge: one at "
            "its free end."
        ),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option("--from", metavar="PRESET", help="Take a preset; without NAME, print it."),
    ] = None,
    presets: Annotated[
        bool, typer.Option("--list", help="Print the names of the presets instead.")
    ] = False,
    schema: Annotated[
        bool,
        typer.Option(
            "--schema",
            help="Print the JSON schema of a case file instead, with which editors check and "
            "complete it.",
        ),
    ] = False,
) -> None:
    """Write a commented case file with every key: its unit, its default, its meaning."""
    from delam_fem.case.definition import Case
    from delam_fem.case.files import PRESETS, preset_text
    from delam_fem.case.keys import case_schema, case_text
    from delam_fem.system.files import write_text

    way = require_one(**{"kind": kind, "from": source, "list": presets, "schema": schema})
    file = name or "beam"
    path = Path(file if file.endswith(SUFFIX) else file + SUFFIX)
    if way in ("list", "schema"):
        if name is not None:
            raise CaseError(f"new {name}: no NAME goes with --{way}; leave it out")
        schema_text = json.dumps(case_schema(), indent=1, ensure_ascii=False)
        lines = "\n".join(PRESETS) if presets else schema_text
        typer.echo(lines if output is None else write_text(output, lines + "\n"))
        return
    text = case_text(kind or "apart", path.stem) if source is None else preset_text(source)
    if source is not None and name is not None:
        text = text.replace(f'name = "{source}"', f"name = {json.dumps(path.stem)}", 1)
    Case.from_toml(text)  # refuses a name that is none
    if source is not None and (name or output) is None:
        typer.echo(text, nl=False)
        return
    path = output or path
    if path.exists():
        raise CaseError(f"new {path}: exists; give another NAME, or remove the file")
    if not path.parent.is_dir():
        raise CaseError(f"new {path}: expected an existing folder, given {path.parent}")
    write_text(path, text)
    typer.echo(path)


def check_command(
    names: Annotated[
        list[str], typer.Argument(metavar="CASE…", help="Presets, case files, or sweep files.")
    ],
    overrides: Overrides = None,
    *,
    engine: Annotated[
        Literal["petsc", "compiled"], typer.Option(help="Engine that is to compute the steps.")
    ] = "petsc",
) -> None:
    """Check cases and sweeps as a run would before its first step, and show what they are."""
    failed = 0
    for name in names:
        try:
            _show(name, overrides, engine)
        except CaseError as error:
            tell(f"delam-fem: {error}")
            failed += 1
    if failed:
        raise typer.Exit(BAD_INPUT)


def _show(name: str, overrides: list[str] | None, engine: EngineName) -> None:
    """Check a case or a sweep and show its table.

    Raises:
        CaseError: the case or the sweep cannot be computed, or needs too much.
    """
    from delam_fem.engines.cost import require_affordable

    path = Path(name)
    if path.suffix == SUFFIX and path.is_file():
        from delam_fem.case.toml import read_toml

        if "axis" in read_toml(path):
            from delam_fem.studies.sweeps.grid import load_sweep
            from delam_fem.studies.sweeps.run import sweep_cost

            sweep = load_sweep(path, overrides_in(overrides))
            show_sweep(sweep)
            what = f"sweep {sweep.file.name}"
            cost = sweep_cost(sweep)
            require_affordable(cost, what, is_confirmed=False)
            return
    show_case(case_of(name, overrides), engine)


def show_case(case: Case, engine: EngineName) -> None:
    """Show the table of a case with what a run needs, and check it as a run would.

    A case that needs much is shown, but not assembled.

    Raises:
        CaseError: the case cannot be computed, or must be confirmed.
    """
    from delam_fem.case import plausible
    from delam_fem.engines.cost import require_affordable, run_cost
    from delam_fem.pipeline import checked
    from delam_fem.results import rest

    cost = run_cost(case, engine)
    rows = [*_about(case)]
    title = f"case {case.name}"
    try:
        require_affordable(cost, title, is_confirmed=False)
    except CaseError:
        table(title, ("", ""), [*rows, ("needs", str(cost))])
        raise
    structure, warnings = checked(case, engine)
    rows.append(("unknowns", str(structure.operators.n_dofs)))
    rows.append(("pairs that may touch", str(structure.operators.gap0.size)))
    rows += rest.rows_of(structure, case)
    table(title, ("", ""), [*rows, ("needs", str(cost))])
    for text in (*warnings, *plausible.of_weight(case)):
        tell(f"warning: {text}")


def show_sweep(sweep: Sweep, workers: int | None = None) -> None:
    """Check the first point of a sweep and show its table, with what the sweep needs.

    Raises:
        CaseError: it cannot be computed.
    """
    from delam_fem.studies.sweeps.run import sweep_cost

    rows = [
        (d.key, f"{len(d.values)} values, {d.values[0]} … {d.values[-1]} {d.units}")
        for d in sweep.dimensions
    ]
    rows += [("points", str(sweep.n_points)), *_about(sweep.case(0))]
    rows.append(("needs", str(sweep_cost(sweep, workers))))
    table(f"sweep {sweep.file.name}", ("", ""), rows)


def _about(case: Case) -> list[tuple[str, str]]:
    """Return rows that say what a case is."""
    from delam_fem.contact.laws import LAWS, combined_name

    law = case.contact.law
    scheme = case.time.scheme
    rows = [
        *((f"lamina {lamina.name}", _lamina(lamina)) for lamina in case.lamina),
        ("structure", _structure(case)),
        *_attached(case),
        *_loads(case),
        ("excitation", case.excitation.words),
        ("contact", f"{combined_name(law, scheme)}: {LAWS[law].meaning}"),
    ]
    if numbers := [*_law_numbers(case)]:
        rows.append(("numbers of the law", ", ".join(numbers)))
    rows += [("time", _time(case)), ("window", _window(case))]
    if case.unread:
        rows.append(("given, but not read", ", ".join(case.unread)))
    return rows


def _lamina(lamina: Lamina) -> str:
    """Return in words what a lamina is: a point, a bar or a beam."""
    if lamina.mass is not None:
        mounting = (
            f"on a spring of {lamina.stiffness:g} N/m" if lamina.stiffness else "that is free"
        )
        return f"a point of {lamina.mass:g} kg {mounting}, D {lamina.damping_ratio:g}"
    stiffness = (
        f"EA {_along(lamina.axial_rigidity_at, lamina)} N"
        if lamina.motion == "axial"
        else f"EI {_along(lamina.flexural_rigidity_at, lamina)} N m²"
    )
    material = _material(lamina)
    return (
        f"{1e3 * lamina.length:g} × {_size(lamina, 'width')} × {_size(lamina, 'thickness')} mm, "
        f"{material}{stiffness}, {_along(lamina.mass_per_length_at, lamina)} kg/m, "
        f"D {lamina.damping_ratio:g}"
    )


def _material(lamina: Lamina) -> str:
    """Return in words what a lamina is made of, with the angles of its layers."""
    if lamina.orthotropic is None:
        return f"{lamina.material}, " if lamina.material else ""
    name = lamina.material if isinstance(lamina.material, str) else "orthotropic"
    if lamina.plies is None:
        return f"{name} at {lamina.angle or 0.0:g}°, "
    return f"{name} [{'/'.join(f'{angle:g}' for angle in lamina.plies)}], "


def _along(course: Callable[[FloatArray], FloatArray], lamina: Lamina) -> str:
    """Return a property at the start of a lamina, and at its end where it changes."""
    import numpy as np

    values = course(np.array([0.0, *lamina.breaks, lamina.length]))
    texts = [f"{value:.4g}" for value in values]
    return texts[0] if len(set(texts)) == 1 else f"{texts[0]} to {texts[-1]}"


def _size(lamina: Lamina, key: str) -> str:
    """Return a size in mm, at the start and at the end where it changes."""
    return _along(lambda x: 1e3 * lamina.along(key, x), lamina)


def _law_numbers(case: Case) -> Iterator[str]:
    """Yield the numbers that the law of a case reads."""
    from delam_fem.case.unread import read_of_contact

    contact = case.contact
    read = read_of_contact(case)
    words = {
        "restitution": f"e = {contact.restitution:g}",
        "impulse": f"{contact.impulse} impulses",
        "penalty_stiffness": f"k = {contact.penalty_stiffness:g} N/m",
        "penalty_damping": f"c = {contact.penalty_damping:g} N s/m",
        "threshold_velocity": f"threshold {contact.threshold_velocity:g} m/s",
    }
    if contact.points_per_element > 1:
        words["points_per_element"] = f"{contact.points_per_element} points per element"
    yield from (text for key, text in words.items() if key in read)


_OWN_NUMBERS = ("restitution", "stiffness", "threshold_velocity")


def _attached(case: Case) -> Iterator[tuple[str, str]]:
    """Yield rows of what acts on the laminae: supports, masses, stops, impactors, sensors."""
    if case.is_plate:
        from delam_fem.case.sections import place_words

        yield "reference points", f"all laminae at {place_words(case.reference_point)}"
    for number, support in enumerate(case.support.placed, start=1):
        yield f"support {number}", _point_support(case, support)
    for number, mass in enumerate(case.point_mass, start=1):
        yield f"point mass {number}", f"{mass.mass:g} kg on {_place(case, mass)}"
    for key, contact_table in case.contacts:
        is_between = key.startswith(("gap", "delamination"))
        if is_between and any(getattr(contact_table, name) is not None for name in _OWN_NUMBERS):
            yield key.replace(".", " "), _contact(case, contact_table)
    for number, stop in enumerate(case.stop, start=1):
        contact = _contact(case, stop)
        yield (
            f"stop {number}",
            f"{stop.side} {_place(case, stop)}, gap {1e3 * stop.gap:g} mm, {contact}, on the "
            f"{stop.on}",
        )
    for number, impactor in enumerate(case.impactor, start=1):
        yield f"impactor {number}", _impactor(case, impactor)
    for number, start in enumerate(case.initial, start=1):
        shape = f"mode {start.mode}" if start.shape == "mode" else start.shape
        yield (
            f"initial {number}",
            f"{shape} of {start.lamina or _all_laminae(case)}: {1e3 * start.displacement:g} mm, "
            f"{start.velocity:g} m/s",
        )
    for sensor in case.sensor:
        rate = f", {sensor.sampling_rate:g} Hz" if sensor.sampling_rate else ", every step"
        noise = f", noise {sensor.noise:g} {sensor.unit}" if sensor.noise else ""
        yield f"sensor {sensor.name}", f"{sensor.words}{rate}{noise}"


def _loads(case: Case) -> Iterator[tuple[str, str]]:
    """Yield rows of weight and constant loads."""
    from delam_fem.case.sections import place_words

    if case.gravity is not None:
        gravity = case.gravity
        yield (
            "gravity",
            f"{gravity.acceleration:g} m/s², inclination {gravity.inclination:g}°, roll "
            f"{gravity.roll:g}°; gaps {gravity.gaps}",
        )
    for number, load in enumerate(case.load, start=1):
        where = load.lamina or (f"between {' and '.join(load.between)}" if load.between else "all")
        if load.axial is not None:
            text = f"tension {load.axial:g} N, {where}"
        elif load.force is not None:
            at = "" if load.position is None else f" at {place_words(load.position)}"
            text = f"{load.force:g} N, {where}{at}"
        else:
            start, end = load.reach(case.length, case.delamination)
            reach = f"{1e3 * start:g} to {1e3 * end:g} mm"
            text = f"{load.per_length:g} N/m, {where}, {reach}"
        yield f"load {number}", text


def _point_support(case: Case, support: PointSupport) -> str:
    """Return in words what a support with a side or a position is."""
    from delam_fem.case.sections import ENDS, place_words

    numbers = [
        f"{value:g} {unit}"
        for value, unit in (
            (support.stiffness or 0.0, "N/m"),
            (support.rotational_stiffness, "N m"),
            (support.damping, "N s/m"),
        )
        if value
    ]
    if support.is_edge:
        return ", ".join([f"{support.kind}, edge {support.side}", *numbers])
    ends: dict[str | None, float] = dict(zip(ENDS, (0.0, case.length), strict=True))
    position = support.position if support.side is None else ends[support.side]
    lamina = support.lamina or _all_laminae(case)
    return ", ".join([f"{support.kind}, {lamina} at {place_words(position)}", *numbers])


def _all_laminae(case: Case) -> str:
    """Return in words what is of all laminae: the name of a single one."""
    return "all laminae" if len(case.lamina) > 1 else case.lamina[0].name


def _impactor(case: Case, impactor: Impactor) -> str:
    """Return in words what an impactor is."""
    contact = _contact(case, impactor)
    if impactor.radius is not None:
        lamina = next(candidate for candidate in case.lamina if candidate.name == impactor.lamina)
        nu = lamina.poisson if case.model.poisson is None else case.model.poisson
        modulus = f"E {1e-9 * lamina.mean('young_modulus'):g} GPa, ν {nu:g}"
        contact = f"a ball of radius {1e3 * impactor.radius:g} mm ({modulus})"
    spring = ""
    if impactor.spring or impactor.spring_damping:
        numbers = f"{impactor.spring:g} N/m, {impactor.spring_damping:g} N s/m"
        spring = f", held by a spring ({numbers}) on the {impactor.on}"
    return (
        f"{impactor.mass:g} kg {impactor.side} {_place(case, impactor)}, gap "
        f"{1e3 * impactor.gap:g} mm, {impactor.velocity:g} m/s, {contact}{spring}"
    )


def _contact(case: Case, table: OwnContact) -> str:
    """Return in words what a contact is: its numbers, where it has some of its own."""
    from delam_fem.case.unread import read_of_entry

    read = read_of_entry(case, table)
    words = ["rigid"] if table.elastic_by is None else []
    for key, text, unit in (
        ("restitution", "e", ""),
        ("stiffness", "k", " N/m"),
        ("damping", "c", " N s/m"),
        ("threshold_velocity", "threshold", " m/s"),
    ):
        value = getattr(table, key)
        is_said = value is not None and (key != "damping" or table.stiffness is not None)
        if is_said and (key in read or case.contact.law == "none"):
            words.append(f"{text} {value:g}{unit}")
    return ", ".join(words)


def _place(case: Case, thing: PointMass | Stop | Impactor) -> str:
    """Return in words where something is."""
    if case.is_of_points:
        return thing.lamina
    start = getattr(thing, "start", None)
    end = getattr(thing, "end", None)
    if start is not None:
        return f"{thing.lamina} from {start:g} to {end:g} m"
    from delam_fem.case.sections import place_words

    x = case.position_of(thing)
    return f"{thing.lamina} at {place_words(x if thing.position is None else thing.position)}"


def _time(case: Case) -> str:
    """Return in words how long a run is, and its steps."""
    if case.time.step is None:
        number = f"{case.n_periods} periods of {case.steps_per_period}"
    else:
        n_steps = case.n_periods * case.steps_per_period
        number = f"{n_steps * case.time_step:g} s, {n_steps}"
    return f"{number} steps of {case.time_step:.4g} s"


def _window(case: Case) -> str:
    """Return in words what of a run is recorded at every step."""
    if case.n_window_periods == case.n_periods:
        return "the whole run"
    if case.time.step is None:
        return f"the last {case.n_window_periods} periods"
    return f"the last {case.n_window_periods * case.period:g} s"


def _structure(case: Case) -> str:
    """Return in words how the laminae are joined, held and divided."""
    mesh = f"{case.mesh.elements} elements" if case.mesh.file is None else case.mesh.file.name
    if case.mesh.across is not None:
        mesh = f"{case.mesh.elements} x {case.mesh.across} cells"
    if case.is_of_points:
        return "points"
    if case.is_apart:
        ends = "clamped at x = 0" if case.support.is_cantilever else _ends(case)
        return f"apart, {ends}, {mesh} each"
    delaminated = ", ".join(map(_patch, case.delamination))
    joined = (
        "" if len(case.lamina) == 1 else f"bonded, delaminated at {delaminated or 'no place'}; "
    )
    kind = "a plate: " if case.is_plate else ""
    return f"{kind}{joined}{_ends(case)}; {mesh}"


def _patch(delamination: Delamination) -> str:
    """Return in words where a delamination is."""
    along = f"{1e3 * delamination.start:g} to {1e3 * delamination.end:g} mm"
    if delamination.across is None:
        return along
    low, high = delamination.across
    shape = "an ellipse in " if delamination.is_ellipse else ""
    return f"{shape}{along} by {1e3 * low:g} to {1e3 * high:g} mm"


def _ends(case: Case) -> str:
    """Return in words how the ends are held."""
    support = case.support
    yields = support.rotational_stiffness
    soft = "" if yields is None else f", clamps of {yields:g} N m"
    kinds = ", ".join(f"{side} {support.kind(side)}" for side in support.sides)
    return f"{kinds}{soft}"


def reduce_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    modes: Annotated[
        int,
        typer.Option(min=1, metavar="N", help="Normal modes of each lamina, or bonded structure."),
    ] = 20,
    coordinates: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Coordinates at most; the stiffest residual shapes are left out.",
        ),
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Reduce a model to modes and residual flexibility, for every other command."""
    from delam_fem.model.reduction import reduced_case
    from delam_fem.system.files import claimed

    case = case_of(case_name, overrides)
    folder = output or Path("runs") / f"{case.name}-reduction"
    with claimed(folder, inputs=case.files.values(), may_hold_results=overwrite) as directory:
        reduction = reduced_case(case, modes, coordinates=coordinates)
        paths = reduction.save(directory)
    say(quiet, paths, tables=_reduced(reduction, paths[0]))


def _reduced(found: Reduction, path: Path) -> Iterator[Rows]:
    """Yield tables of what a reduction keeps, how exact it is, and what it costs."""
    o = found.full.operators
    reduced = found.structure.operators
    basis = found.basis
    normal = int(basis.is_mode.sum())
    rows = [
        ("unknowns of the full model", str(o.n_dofs)),
        ("coordinates", str(reduced.n_dofs)),
        ("normal modes", f"{normal} of {basis.body.max() + 1} bodies"),
        ("residual shapes", f"{reduced.n_dofs - normal}, {basis.dropped} left out"),
        ("pairs that may touch", str(o.n_pairs)),
        ("highest frequency of a normal mode", f"{found.highest_mode:.5g} Hz"),
        ("highest frequency of all", f"{found.highest:.5g} Hz"),
        ("largest error of the residual flexibility", f"{basis.compliance_error:.1e}"),
        ("assembly, reduction", f"{found.seconds[0]:.2g} s, {found.seconds[1]:.2g} s"),
        ("size of the file", f"{path.stat().st_size / 1e6:.2g} MB"),
    ]
    yield f"case {found.case.name}, reduced", ("", "value"), rows
    full, of_reduction = found.frequencies
    yield (
        "lowest frequencies",
        ("mode", "full [Hz]", "reduced [Hz]", "relative difference"),
        [
            (str(k + 1), f"{f:.6g}", f"{g:.6g}", f"{(g - f) / f if f else 0.0:+.1e}")
            for k, (f, g) in enumerate(zip(full, of_reduction, strict=True))
        ],
    )


def operators_command(
    case_name: CaseArgument,
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="FILE", help="A file that ends in .npz or .mat."),
    ],
    overrides: Overrides = None,
    *,
    overwrite: OverwriteFile = False,
    quiet: Quiet = False,
) -> None:
    """Write M, C, K, H, g0 and the vectors of the base for other programs (NumPy or MATLAB)."""
    from delam_fem.results.export import operators
    from delam_fem.system.files import require_replaceable

    require_replaceable([output], is_overwriting=overwrite)
    say(quiet, [operators(case_of(case_name, overrides), output)])
