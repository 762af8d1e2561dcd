"""The seam: what studies, scripts and tests outside the simulator may use of it.

A study is written with the names below and those of its own folder, so that everything behind them
is free to change. A name keeps its meaning for one minor release after a warning of its end. Users
of cases and results need `delam_fem` alone.

    Cases:      what to compute: reading, writing, checking and changing it
    Laws:       contact laws and time schemes
    Structures: operators, layouts and linear motions of a case
    Motions:    sessions, states, records and what they cost
    Results:    results of a run, their files and verdicts
    Studies:    what a study is, what it finds, and how that is written
    House:      errors, files, types and processes
    Namespaces: modules that are used as a whole: mathematics, numbers of a result, figures, pages

A name is loaded from its module at its first use, so that importing this module costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from delam_fem.case.definition import WITHOUT_FRAMES as WITHOUT_FRAMES, Case as Case
    from delam_fem.case.excitation import (
        Excitation as Excitation,
        ForceExcitation as ForceExcitation,
        HarmonicExcitation as HarmonicExcitation,
        MultisineExcitation as MultisineExcitation,
        SweepExcitation as SweepExcitation,
        SweptMotion as SweptMotion,
        base_motion as base_motion,
        drive as drive,
        parts_of as parts_of,
        places_of as places_of,
        swept_motion as swept_motion,
    )
    from delam_fem.case.files import (
        PRESETS as PRESETS,
        CaseSource as CaseSource,
        find_case as find_case,
        load_case as load_case,
        preset as preset,
        save_case as save_case,
    )
    from delam_fem.case.gap import initial_gap as initial_gap
    from delam_fem.case.identity import (
        belong as belong,
        content_of as content_of,
        digest as digest,
        identity as identity,
        require_same as require_same,
    )
    from delam_fem.case.keys import tables as tables
    from delam_fem.case.sections import (
        Contact as Contact,
        InitialGap as InitialGap,
        Lamina as Lamina,
        Sensor as Sensor,
    )
    from delam_fem.case.surface_scan import read_points as read_points
    from delam_fem.case.tables import (
        DAY as DAY,
        TableColumns as TableColumns,
        heading as heading,
        read_columns as read_columns,
    )
    from delam_fem.case.toml import (
        LISTS as LISTS,
        Data as Data,
        apply_overrides as apply_overrides,
        message as message,
        read_toml as read_toml,
        shown as shown,
        toml_text as toml_text,
    )
    from delam_fem.case.values import (
        CountOrNone as CountOrNone,
        Expected as Expected,
        Label as Label,
        NotNegative as NotNegative,
        Positive as Positive,
        Section as Section,
        in_si as in_si,
        inconsistent as inconsistent,
    )
    from delam_fem.contact.decisions import (
        Kinematics as Kinematics,
        LawContext as LawContext,
        PairState as PairState,
    )
    from delam_fem.contact.laws import (
        COMBINATIONS as COMBINATIONS,
        LAWS as LAWS,
        SCHEMES as SCHEMES,
        Impulse as Impulse,
        Law as Law,
        Scheme as Scheme,
        combined_name as combined_name,
    )
    from delam_fem.engines.cost import (
        FILE_BYTES as FILE_BYTES,
        POINT_SECONDS as POINT_SECONDS,
        STUDY_SECONDS as STUDY_SECONDS,
        WORKER_BYTES as WORKER_BYTES,
        Cost as Cost,
        require_affordable as require_affordable,
        run_cost as run_cost,
        step_hours as step_hours,
    )
    from delam_fem.engines.massless import (
        Period as Period,
        PeriodDrive as PeriodDrive,
        Periods as Periods,
    )
    from delam_fem.engines.session import (
        EngineName as EngineName,
        ImpactTable as ImpactTable,
        Prescribed as Prescribed,
        Session as Session,
        Solution as Solution,
        by_period as by_period,
        engine_of as engine_of,
        initialise_petsc_alone as initialise_petsc_alone,
        modes_of as modes_of,
        motion_of as motion_of,
        scheme_of as scheme_of,
        session as session,
        session_of as session_of,
        solve as solve,
        span_of as span_of,
        start_of as start_of,
    )
    from delam_fem.model.beams.closed_form import beam as beam
    from delam_fem.model.beams.network import network as network
    from delam_fem.model.discretise import (
        assemble as assemble,
        require_held as require_held,
        require_kind as require_kind,
    )
    from delam_fem.model.factors import (
        Factor as Factor,
        factored as factored,
    )
    from delam_fem.model.layout import (
        CURVATURE as CURVATURE,
        Layout as Layout,
        Part as Part,
        Place as Place,
        Structure as Structure,
        columns_of as columns_of,
        interpolation as interpolation,
        nodal as nodal,
        place_of as place_of,
        selection as selection,
    )
    from delam_fem.model.linear import (
        at_start as at_start,
        closed_by as closed_by,
        elastic as elastic,
        first_mode as first_mode,
        first_shapes as first_shapes,
        keeping_closed as keeping_closed,
        largest_stable_time_step as largest_stable_time_step,
        lowest as lowest,
        n_rigid as n_rigid,
        opening_amplitude as opening_amplitude,
        openings as openings,
        response as response,
    )
    from delam_fem.model.loads import springs_of as springs_of
    from delam_fem.model.massless import Reduced as Reduced, reduce as reduce
    from delam_fem.model.mesh import node_coordinates as node_coordinates
    from delam_fem.model.operators import (
        BaseCoupling as BaseCoupling,
        Operators as Operators,
        n_columns as n_columns,
        restricted as restricted,
        times as times,
    )
    from delam_fem.model.places import scanned_places as scanned_places
    from delam_fem.model.reduction import reduced_case as reduced_case
    from delam_fem.model.responses import of_channels as of_channels
    from delam_fem.model.sharing import together as together
    from delam_fem.model.solids.body import Body as Body
    from delam_fem.model.solids.mesh import volumes as volumes
    from delam_fem.model.solids.meshing import cells_along as cells_along, solid_mesh as solid_mesh
    from delam_fem.model.stops_sensors import struck as struck, with_sensors as with_sensors
    from delam_fem.numerics import (
        beams as beams,
        harmonics as harmonics,
        settling as settling,
        spectra as spectra,
        statistics as statistics,
    )
    from delam_fem.numerics.types import (
        BoolArray as BoolArray,
        FloatArray as FloatArray,
        IntArray as IntArray,
    )
    from delam_fem.pipeline import run as run
    from delam_fem.plugins.options import Flag as Flag, Options as Options
    from delam_fem.plugins.report import (
        Finding as Finding,
        Picture as Picture,
        Report as Report,
        Table as Table,
        number as number,
    )
    from delam_fem.plugins.study import Kinds as Kinds, RunContext as RunContext, Study as Study
    from delam_fem.results import (
        diagnostics as diagnostics,
        netcdf as netcdf,
        record as record,
        schema as schema,
    )
    from delam_fem.results.channels import (
        History as History,
        chosen as chosen,
        histories_of as histories_of,
        of_references as of_references,
        offered as offered,
        require_channels as require_channels,
    )
    from delam_fem.results.figures import style as style
    from delam_fem.results.folder import Result as Result
    from delam_fem.results.netcdf import (
        open_dataset as open_dataset,
        write_dataset as write_dataset,
    )
    from delam_fem.results.pages import html as html
    from delam_fem.results.quality import (
        BLOW_STEPS as BLOW_STEPS,
        OPEN as OPEN,
        blow_steps as blow_steps,
        decay_of as decay_of,
        is_lost as is_lost,
        settling_summary as settling_summary,
        stop_when_settled as stop_when_settled,
        verdict_of as verdict_of,
    )
    from delam_fem.results.reading import load_numbers as load_numbers
    from delam_fem.results.schema import (
        CHANNEL_MEASURES as CHANNEL_MEASURES,
        MEASURES as MEASURES,
        SENSOR as SENSOR,
        SHOWN as SHOWN,
        Variable as Variable,
        blas as blas,
        occasion as occasion,
        origin as origin,
        processor as processor,
        provenance as provenance,
        versions as versions,
    )
    from delam_fem.simulation.checkpoint import (
        CHECKPOINT_SECONDS as CHECKPOINT_SECONDS,
        STOPPING as STOPPING,
        stop_signals as stop_signals,
    )
    from delam_fem.simulation.loop import (
        Engine as Engine,
        State as State,
        initial_state as initial_state,
        one_period as one_period,
        set_initial as set_initial,
    )
    from delam_fem.simulation.recorder import (
        LEDGER as LEDGER,
        N_BASE as N_BASE,
        N_SIZES as N_SIZES,
        PeriodRecord as PeriodRecord,
        Recorder as Recorder,
    )
    from delam_fem.simulation.refinement import Span as Span
    from delam_fem.simulation.signals import (
        displacements_of as displacements_of,
        frames_of as frames_of,
    )
    from delam_fem.system import footprint as footprint, hdf5 as hdf5
    from delam_fem.system.errors import (
        CaseError as CaseError,
        reason_of as reason_of,
        require as require,
    )
    from delam_fem.system.files import (
        atomic as atomic,
        atomic_file as atomic_file,
        discard as discard,
        json_ready as json_ready,
        read_arrays as read_arrays,
        remove_kept as remove_kept,
        rewritten as rewritten,
        write_arrays as write_arrays,
        write_json as write_json,
        write_text as write_text,
    )
    from delam_fem.system.hdf5 import require_alone as require_alone
    from delam_fem.system.imports import (
        ONE_THREAD as ONE_THREAD,
        added as added,
        keep_garbage as keep_garbage,
    )
    from delam_fem.system.mpi import MPI as MPI
    from delam_fem.system.written import listed as listed

_HOMES = {
    # Cases
    "case.definition": "WITHOUT_FRAMES Case",
    "case.excitation": (
        "Excitation ForceExcitation HarmonicExcitation MultisineExcitation SweepExcitation "
        "SweptMotion base_motion "
        "drive parts_of places_of swept_motion"
    ),
    "case.files": "PRESETS CaseSource find_case load_case preset save_case",
    "case.gap": "initial_gap",
    "case.identity": "belong content_of digest identity require_same",
    "case.keys": "tables",
    "case.surface_scan": "read_points",
    "case.sections": "Contact InitialGap Lamina Sensor",
    "case.tables": "DAY TableColumns heading read_columns",
    "case.toml": "LISTS Data apply_overrides message read_toml shown toml_text",
    "case.values": ("CountOrNone Expected Label NotNegative Positive Section in_si inconsistent"),
    # Laws
    "contact.decisions": "Kinematics LawContext PairState",
    "contact.laws": "COMBINATIONS LAWS SCHEMES Impulse Law Scheme combined_name",
    # Structures
    "model.stops_sensors": "struck with_sensors",
    "model.discretise": "assemble require_held require_kind",
    "model.factors": "Factor factored",
    "model.layout": (
        "CURVATURE Layout Part Place Structure columns_of interpolation nodal place_of selection"
    ),
    "model.linear": (
        "at_start closed_by elastic first_mode first_shapes keeping_closed "
        "largest_stable_time_step lowest n_rigid opening_amplitude openings response"
    ),
    "model.loads": "springs_of",
    "model.mesh": "node_coordinates",
    "model.beams.closed_form": "beam",
    "model.beams.network": "network",
    "model.operators": "BaseCoupling Operators n_columns restricted times",
    "model.massless": "Reduced reduce",
    "model.places": "scanned_places",
    "model.reduction": "reduced_case",
    "model.responses": "of_channels",
    "model.sharing": "together",
    "model.solids.body": "Body",
    "model.solids.mesh": "volumes",
    "model.solids.meshing": "cells_along solid_mesh",
    # Motions
    "engines.cost": (
        "FILE_BYTES POINT_SECONDS STUDY_SECONDS WORKER_BYTES Cost require_affordable run_cost "
        "step_hours"
    ),
    "engines.massless": "Period PeriodDrive Periods",
    "engines.session": (
        "EngineName ImpactTable Prescribed Session Solution by_period engine_of "
        "initialise_petsc_alone modes_of motion_of scheme_of session session_of solve "
        "span_of start_of"
    ),
    "pipeline": "run",
    "simulation.checkpoint": "CHECKPOINT_SECONDS STOPPING stop_signals",
    "simulation.loop": "Engine State initial_state one_period set_initial",
    "simulation.recorder": "LEDGER N_BASE N_SIZES PeriodRecord Recorder",
    "simulation.refinement": "Span",
    "simulation.signals": "displacements_of frames_of",
    # Results
    "results.folder": "Result",
    "results.netcdf": "open_dataset write_dataset",
    "results.quality": (
        "BLOW_STEPS OPEN blow_steps decay_of is_lost settling_summary stop_when_settled verdict_of"
    ),
    "results.reading": "load_numbers",
    "results.channels": "History chosen histories_of of_references offered require_channels",
    "results.schema": (
        "CHANNEL_MEASURES MEASURES SENSOR SHOWN Variable blas occasion origin processor "
        "provenance versions"
    ),
    # Studies
    "plugins.options": "Flag Options",
    "plugins.report": "Finding Picture Report Table number",
    "plugins.study": "Kinds RunContext Study",
    # House
    "system.errors": "CaseError reason_of require",
    "system.files": (
        "atomic atomic_file discard json_ready read_arrays remove_kept rewritten write_arrays "
        "write_json write_text"
    ),
    "system.hdf5": "require_alone",
    "system.imports": "ONE_THREAD added keep_garbage",
    "system.mpi": "MPI",
    "system.written": "listed",
    "numerics.types": "BoolArray FloatArray IntArray",
    # Namespaces
    "numerics": "beams harmonics settling spectra statistics",
    "results": "diagnostics netcdf record schema",
    "results.figures": "style",
    "results.pages": "html",
    "system": "footprint hdf5",
}
"""Names by the module or folder that defines them, relative to the package."""
_MODULES = {name: home for home, names in _HOMES.items() for name in names.split()}


def home_of(name: str) -> str:
    """Return the module or folder that defines a name, relative to the package."""
    return _MODULES[name]


def __getattr__(name: str) -> object:
    """Import the module of a name at its first use, and return the object."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = f"delam_fem.{home_of(name)}"
    module = import_module(home)
    value: object = getattr(module, name, None)
    if value is None:  # a module of the folder
        value = import_module(f"{home}.{name}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the names of the seam."""
    return sorted(_MODULES)
