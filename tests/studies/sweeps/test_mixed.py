"""Grids, points and datasets of sweeps in full; no two axes, laminae or records are alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import golden
import numpy as np
import pytest
import xarray as xr
from mixed import IMPACTORS, MASSES, SENSORS, STOPS, apart, bonded

from delam_fem.engines.cost import Cost
from delam_fem.simulation.loop import State
from delam_fem.studies.sweeps import run as run_module
from delam_fem.studies.sweeps.grid import Sweep, SweepFile, require_valid, sweep_of
from delam_fem.studies.sweeps.journal import Journal, packed, payloads, unpacked
from delam_fem.studies.sweeps.point import (
    Chunk,
    Done,
    Point,
    PointRunner,
    assembly_key,
    mean_growth,
    quantities,
)
from delam_fem.studies.sweeps.run import (
    PointCost,
    array_script,
    completed,
    share_size,
    sweep_cost,
)
from delam_fem.studies.sweeps.schedule import Shard, named, owners, parse_shard
from delam_fem.system.errors import CaseError

Check = Callable[..., None]
RUNS = {
    "mesh": {"elements": 5}, "stop": [], "impactor": [], "point_mass": MASSES[:1],
    "time": {"steps_per_period": 120, "periods": 7},
    "output": {"window_periods": 5, "fields_per_period": 12},
    "excitation": {"kind": "harmonic", "amplitude": 2e-3, "frequency": 27.0},
}  # fmt: skip
AXES: dict[str, dict[str, Any]] = {
    "product": {"axis": [
        {"key": "excitation.frequency", "start": 20, "stop": 32, "count": 4},
        {"key": "lamina.mid.thickness", "values": ["1.5 mm", "2 mm", 0.0022]},
        {"key": "gap.tip", "start": 1e-3, "stop": 8e-3, "count": 2, "spacing": "logarithmic"},
    ]},
    "zip": {"combine": "zip", "start": "steady", "axis": [
        {"key": "excitation.frequency", "values": [20.0, 23.5, 29.0]},
        {"key": "support.start", "name": "held", "values": ["clamped", "clamped", "clamped"]},
    ]},
    "both": {"order": "both", "initial": {"low": {"displacement": 1e-4}}, "axis": [
        {"key": "excitation.frequency", "values": [25.0, 20.0, 31.0]},
        {"key": "initial.mid.velocity", "values": [0.1, -0.2]},
    ]},
    "many": {"axis": [
        {"key": "excitation.frequency", "start": 20.0, "stop": 32.0, "count": 2500},
        {"key": "contact.restitution", "start": 0.1, "stop": 0.9, "count": 900},
    ]},
    "down": {"order": "down", "axis": [
        {"key": "excitation.frequency", "values": [25.0, 31.0, 20.0]},
        {"key": "contact.restitution", "name": "e", "values": [0.1, 0.3]},
    ]},
}  # fmt: skip


def sweep(name: str, **options: Any) -> Sweep:
    """Return a sweep with given axes."""
    contact = {"law": "newton", "restitution": 0.35}
    data = {"name": name, "base": "mixed"} | AXES[name] | options
    found = Sweep(apart(**RUNS, contact=contact), SweepFile.model_validate(data))
    require_valid(found)
    return found


@pytest.mark.parametrize("name", [name for name in AXES if name != "many"])
def test_grids_are_the_stored_ones(name: str, stored: Check) -> None:
    own = sweep(name)
    n = own.n_points
    found = {
        "dimensions": own.dimensions, "sizes": own.sizes, "n": n, "tracks": own.tracks,
        "overrides": [repr(own.overrides(k)) for k in range(n)],
        "initial": [own.initial(k) for k in range(n)], "file": own.to_toml("base.toml"),
        "identity": own.identity, "html": own._repr_html_().partition("</table>")[0],
        "keys": len({assembly_key(own.case(k)) for k in range(n)}),
        "shares": [share_size(own, Shard(k, 2)) for k in (1, 2)],
    }  # fmt: skip
    stored(golden.of_object(found))


def described(data: xr.Dataset) -> str:
    """Return what a dataset holds, but not where and when it was made."""
    kept = ("title", "outcome", "engine", "sweep", "coordinates")
    about = {k: v for k, v in data.attrs.items() if k in kept or k.startswith("n_")}
    lines = [golden.of_object(about, "attributes")]
    for name in [*data.coords, *data.data_vars]:
        own = data[name]
        value = own.values if own.dtype.kind == "f" else own.values.tolist()
        if name == "energy_residual":
            value = np.where(np.abs(own.values) < 1e-9, 0.0, own.values)
        lines.append(f"{name} {own.dims} {sorted(own.attrs.items())}")
        lines.append(golden.of_object(value, str(name)))
    return "\n".join(lines)


RECORDS: Mapping[str, dict[str, Any]] = {
    "product": {
        "strobes": 3, "harmonics": 4, "node_distortion": True, "energies": True, "lyapunov": 12,
        "scan": {"lamina": "low", "spacing": 0.09, "first": 0.04},
    },
    "both": {"strobes": 20, "harmonics": 2, "lyapunov": 6, "perturbation": 0.2},
    "zip": {"summary": False, "harmonics": 80, "scan": {"spacing": 0.11}},
    "down": {"strobes": 0, "energies": True},
}  # fmt: skip


@pytest.mark.parametrize("name", RECORDS)
def test_datasets_are_the_stored_ones(name: str, stored: Check, tmp_path: Path) -> None:
    own = sweep(name, record=RECORDS[name])
    stored(described(completed(own, tmp_path, "serial")))


def test_points_of_stacks_are_the_stored_ones(stored: Check) -> None:
    """With stops, impactors and sensors; a run that diverges; a point that fails."""
    sensors = [*SENSORS, {"name": "s", "quantity": "contact force", "stop": 1}]
    sensors[1] = sensors[1] | {"sampling_rate": 700.0}
    case = bonded(
        **RUNS | {"mesh": {"elements": 14}, "stop": STOPS[1:2], "impactor": IMPACTORS},
        contact={"law": "penalty", "penalty_stiffness": 3e3, "penalty_damping": 0.3},
        sensor=sensors,
    )
    own = Sweep(
        case,
        {"excitation.frequency": [27.0, 29.0], "mesh.elements": [14, 15]},
        record={"harmonics": 3, "energies": True},
    )
    runner = PointRunner(own)
    lines = []
    for index in range(4):
        point, state = runner.point(index, None)
        row = point.row if point.row is not None else np.zeros(0)
        told = {"outcome": point.outcome, "error": point.error}
        lines.append(golden.of_object(told | {"state": state is not None}, str(index)))
        begin = 0
        for quantity in quantities(own.file.record, runner.structure(own.case(index)).layout):
            value = row[begin : begin + quantity.size]
            begin += quantity.size
            tiny = quantity.name == "energy_residual"
            shown = np.where(np.abs(value) < 1e-9, 0.0, value) if tiny else value
            lines.append(golden.of_object(shown, f"{index}.{quantity.name}"))
            lines.append(f"{quantity.dims} {quantity.units} {quantity.long_name}")
        begin_again = runner.point(index, state)[0].row
        lines.append(golden.of_object(begin_again, f"{index} again"))
    stored("\n".join(lines))


def test_growth_is_the_stored_one(stored: Check) -> None:
    rates = np.cos(np.arange(37) ** 1.3)
    found = [mean_growth(rates[:k]) for k in (9, 10, 37)]
    stored(golden.of_object([[own.value, own.error] for own in found]))


def test_shards_are_the_stored_ones(stored: Check) -> None:
    found: dict[str, Any] = {}
    for of in (1, 2, 3, 7):
        found[str(of)] = [Shard(k, of).items(23) for k in range(1, of + 1)]
        found[f"owners {of}"] = owners(np.arange(23), of)
    found["names"] = [Shard(2, 7).name, str(Shard(2, 7)), repr(named("2-of-7.part")), named("x")]
    found["whole"] = [Shard(1, 1).is_whole, Shard(1, 2).is_whole]
    for text in ("1/1", " 3/16", "7 /7", "0/3", "4/3", "1/0", "a/3", "3", "1/100000", "1/10000001"):
        try:
            found[f"parse {text}"] = str(parse_shard(text))
        except CaseError as error:
            found[f"parse {text}"] = str(error)
    stored(golden.of_object(found))


@pytest.mark.parametrize("name", AXES)
def test_costs_and_scripts_are_the_stored_ones(
    name: str, stored: Check, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Times of steps are those of a machine; here each has a round number."""
    monkeypatch.setattr(run_module, "step_hours", lambda case, engine: 0.25)
    monkeypatch.setattr(run_module.executors, "n_cores", lambda: 3)
    own = sweep(name, record=RECORDS.get(name, {}))
    costs = [sweep_cost(own), sweep_cost(own, 2), sweep_cost(own, 5, 70)]
    assert all(isinstance(cost, Cost) for cost in costs)
    lines = [golden.of_object({str(k): cost for k, cost in enumerate(costs)})]
    for shards, hours, cost in (
        (1, 8.0, PointCost(0.7, 2.0, 17)),
        (2, 0.5, PointCost(450.0, 460.0, 3)),
        (2, 300.0, PointCost(9000.0, 9900.0, 5)),
        (2, 0.01, PointCost(3.0, 4.5, 5)),
        (3, 1.0, PointCost(0.1, 0.2, 1)),
        (99, 1.0, PointCost(0.1, 0.2, 1)),
        (0, 1.0, PointCost(0.1, 0.2, 1)),
    ):
        try:
            script = array_script(
                own, ["delam-fem", "sweep", "a b.toml"], shards, cost, most_hours=hours,
                interrupted=7,
            )  # fmt: skip
            chosen = [li for li in script.splitlines() if li.startswith("#") or "merge" in li]
            lines.append("\n".join(chosen if shards > 1 else script.splitlines()))
        except CaseError as error:
            lines.append(str(error))
    stored("\n".join(lines).replace("needs about", "needs"))


BAD: tuple[dict[str, Any], ...] = (
    {"axis": []},
    {"axis": [{"key": "frequency", "values": [1.0]}]},
    {"axis": [{"key": "excitation.frequency"}]},
    {"axis": [{"key": "excitation.frequency", "start": 1.0, "stop": 2.0}]},
    {"axis": [{"key": "excitation.frequency", "start": 1.0, "values": [2.0]}]},
    {"axis": [{"key": "excitation.frequency", "values": [2.0], "spacing": "linear"}]},
    {"axis": [{"key": "contact.law", "values": ["newton", 2.0]}]},
    {"axis": [{"key": "gap.tip", "start": 0.0, "stop": 1.0, "count": 3, "spacing": "logarithmic"}]},
    {"axis": [{"key": "gap.tip", "start": 1, "stop": 3, "count": 1000001}]},
    {"axis": [{"key": "gap.tip", "values": ["3 Hz"]}]},
    {"axis": [{"key": "contact.restitution", "start": "3 mm", "stop": 1, "count": 2}]},
    {"axis": [{"key": "exitation.frequenzy", "start": "3 Hz", "stop": 1, "count": 2}]},
    {"axis": [{"key": "gap.tip", "values": [0.01]}, {"key": "gap.tip", "values": [0.02]}]},
    {"combine": "zip", "axis": [{"key": "gap.tip", "values": [0.01]},
                                {"key": "gap.exponent", "values": [1.0, 2.0]}]},
    {"start": "steady", "initial": {"thin.velocity": 1.0}, "axis": [
        {"key": "gap.tip", "values": [0.01]}]},
    {"start": "steady", "axis": [{"key": "initial.thin.velocity", "values": [0.01]}]},
    {"order": "up", "axis": [{"key": "contact.law", "values": ["newton", "penalty"]}]},
    {"order": "up", "axis": [{"key": "mesh.elements", "values": [4, 5]}]},
    {"order": "up", "axis": [{"key": "contact.points_per_element", "values": [1, 2]}]},
    {"initial": {"thin.speed": 1.0}, "axis": [{"key": "gap.tip", "values": [0.01]}]},
    {"initial": {"thin.velocity": True}, "axis": [{"key": "gap.tip", "values": [0.01]}]},
    {"axis": [{"key": "gap.tip", "name": "strobe", "values": [0.01]}]},
    {"axis": [{"key": "gap.tip", "name": "a", "values": [0.01]},
              {"key": "gap.exponent", "name": "a", "values": [2.0]}]},
    {"axis": [{"key": "gap.tip", "values": [0.01, -1.0]}]},
    {"record": {"node_distortion": True}, "set": {"output.fields_per_period": 3}, "axis": [
        {"key": "gap.tip", "values": [0.01]}]},
    {"record": {"node_distortion": True}, "set": {"output.fields_per_period": 7}, "axis": [
        {"key": "gap.tip", "values": [0.01]}]},
    {"record": {"node_distortion": True}, "axis": [{"key": "mesh.elements", "values": [4]}]},
    {"record": {"scan": {"spacing": 0.1}}, "set": {"output.fields_per_period": 4}, "axis": [
        {"key": "gap.tip", "values": [0.01]}]},
    {"record": {"scan": {"spacing": 0.1}}, "set": {"output.window_periods": 3}, "axis": [
        {"key": "gap.tip", "values": [0.01]}]},
    {"record": {"lyapunov": 3}, "set": {"excitation.kind": "sweep"}, "axis": [
        {"key": "gap.tip", "values": [0.01]}]},
    {"base": "nothing.toml", "axis": [{"key": "gap.tip", "values": [0.01]}]},
)  # fmt: skip


def test_what_is_wrong_is_told_as_stored(stored: Check, elsewhere: None) -> None:
    lines = []
    for data in BAD:
        try:
            found = sweep_of({"name": "bad", "base": "paper"} | data)
            lines.append(f"{found.n_points} points")
        except CaseError as error:
            lines.append(str(error))
    stored(golden.spoken("\n".join(lines)))


def done(track: int, indices: tuple[int, ...], shift: float, **more: Any) -> Done:
    """Return a finished chunk; every third point has failed and every fifth diverged."""
    points = tuple(
        Point(i, "failed", f"no {i}", None) if i % 3 == 2
        else Point(i, "diverged", f"far {i}", None) if i % 5 == 4
        else Point(i, "completed", "", np.array([i + shift, -0.5 * i, 7.0]))
        for i in indices
    )  # fmt: skip
    state = State(shift + np.arange(12.0).reshape(3, 4), np.array([True, False, True]), (0.3, 0.7))
    if track == 1:
        state = replace(state, internal=np.array([0.1, 0.2]))
    chunk = Chunk(track, indices)
    return Done(chunk, points, state if track >= 0 else None, 0.25 * len(indices), 0.1)


def test_journals_are_the_stored_ones(
    stored: Check, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Of two shards that overlap, one of which is damaged."""
    chunks = [done(-1, (0, 1, 2, 3), 0.0), done(0, (10, 12), 0.0), done(1, (20, 22, 24), 0.0),
              done(1, (26, 28), 0.5)]  # fmt: skip
    again = [done(-1, (3, 4, 5), 0.0), done(0, (12, 11, 13), 0.25), done(-1, (30, 31), 0.0)]
    told: dict[str, Any] = {}
    for k, chunk in enumerate(chunks):
        record = packed(chunk)
        (span,) = payloads(record)
        kept = unpacked(record, span[0])
        told[f"chunk {k}"] = {
            "size": len(record), "span": span, "track": kept.track, "indices": kept.indices,
            "others": repr(kept.others), "rows": kept.rows, "took": kept.seconds,
            "state": kept.state,
        }  # fmt: skip
    path = tmp_path / "sweep.journal"
    for number, own in enumerate((chunks, again), 1):
        with Journal(path, "one", resume=False, shard=Shard(number, 2)) as journal:
            for chunk in own:
                journal.add([chunk])
    tracks = {0: np.array([10, 12, 11, 13]), 1: np.array([20, 22, 24, 26, 28, 29])}
    for damaged in (False, True):
        if damaged:
            file = min(path.glob("1-of-2*.points"))
            data = bytearray(file.read_bytes())
            data[len(data) - 400] ^= 255
            file.write_bytes(bytes(data))
        with Journal(path, "one", resume=True) as journal, journal.joined() as joined:
            block = joined.block(2, 25, 3)
            told[f"joined {damaged}"] = {
                "numbers": joined.numbers, "counts": joined.counts(), "took": joined.seconds,
                "disagreeing": joined.n_disagreeing, "shards": sorted(map(str, joined.shards)),
                "block": [block.numbers, block.outcomes, block.rows],
                "errors": repr(sorted(block.errors.items())),
                "reached": [[n, "none" if state is None else state.motion]
                            for n, state in (joined.reached(v, k) for k, v in tracks.items())],
            }  # fmt: skip
    lines = [golden.of_object(told)]
    lines += [record.getMessage().partition(": ")[2] for record in caplog.records]
    for identity, resume in (("another", True), ("one", False)):
        try:
            with Journal(path, identity, resume=resume) as journal, journal.joined():
                lines.append("opened")
        except CaseError as error:
            lines.append(str(error).replace(str(tmp_path), "folder").partition("of-2.")[0])
    stored("\n".join(lines))
