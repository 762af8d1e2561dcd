"""What a laboratory computes, and what it reads of results, with stand-ins for the runs."""

from collections.abc import Callable
from concurrent.futures import Future
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from delam_fem.api import Case
from delam_fem.paper import portraits, runs as lab_module, shapes
from delam_fem.paper.claims import Numbers, judged
from delam_fem.paper.runs import BEATS, MOTIONS, SAME_FREQUENCY, Effort, Laboratory, motion_case
from delam_fem.paper.shapes import BEGUN, HELD, OPEN, RELEASED, SEPARATING, STRUCK


class Now:
    """An executor that computes at once and counts."""

    def __init__(self) -> None:
        self.submitted: list[Any] = []

    def submit(self, function: Callable[..., Any], *given: Any, **named: Any) -> Future[Any]:
        self.submitted.append((function, given, named))
        future: Future[Any] = Future()
        future.set_result(function(*given, **named))
        return future


def finished(case: Case, outcome: str = "completed") -> Any:
    return SimpleNamespace(case=case, history=SimpleNamespace(attrs={"outcome": outcome}))


def test_motions_are_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    executor: Any = Now()
    monkeypatch.setattr(lab_module, "_computed", lambda case, engine: finished(case, "completed"))
    laboratory = Laboratory(Effort(), executor, "petsc")
    one, two = (motion_case(f, Effort(periods=3)) for f in (1.25, 3.25))
    first = laboratory.motions([one, two, one])
    assert [result.case for result in first] == [one, two, one] and first[0] is first[2]
    assert [arguments for _, arguments, _ in executor.submitted] == [(one, "petsc"), (two, "petsc")]
    assert laboratory.motions([two])[0] is first[1] and len(executor.submitted) == 2
    other = motion_case(1.25, Effort(periods=4))
    assert laboratory.motions([other, one])[1] is first[0] and len(executor.submitted) == 3


def test_a_motion_that_did_not_end_is_told_with_its_case(monkeypatch: pytest.MonkeyPatch) -> None:
    executor: Any = Now()
    monkeypatch.setattr(lab_module, "_computed", lambda case, engine: finished(case, "diverged"))
    case = motion_case(1.25, Effort(periods=3))
    with pytest.raises(RuntimeError) as error:
        Laboratory(Effort(), executor).motions([case])
    assert str(error.value) == f"case paper diverged; the case is\n{case.to_toml()}"


def test_what_has_begun_is_not_begun_again() -> None:
    executor: Any = Now()
    laboratory = Laboratory(Effort(), executor)
    first = laboratory.begin("sum", lambda a, b: a + b, a=1, b=2)
    assert laboratory.begin("sum", lambda: 9) is first and first.result() == 3
    assert laboratory.begin("other", lambda: 9).result() == 9 and len(executor.submitted) == 2


def test_the_case_of_a_motion() -> None:
    case = motion_case(1.6, Effort(periods=7), "3.1", {"mesh.elements": 5})
    assert (case.excitation.frequency, case.contact.law, case.n_periods) == (1.6, "newton", 7)
    assert case.output.fields_per_period == 100
    assert case.mesh.elements == 5
    assert motion_case(1.6, Effort()).contact.law == "newton-penalty"
    assert motion_case(1.6, Effort(), overrides={"time.periods": 9}).n_periods == 9


# ---- the four motions


def shown(contacts: float | None, speeds: tuple[float, float] = (0.0, 0.0), **more: Any) -> Any:
    summary = {"tip_contacts_per_period": contacts, "minimum_tip_gap": 1e-3, "periodicity": 1}
    return SimpleNamespace(summary=summary | more, speeds=speeds)


@pytest.mark.parametrize(
    ("which", "result", "is_shown"),
    [
        (0, shown(0.0), True),
        (0, shown(None), True),
        (0, shown(0.5), False),
        (0, shown(0.0, minimum_tip_gap=0.0), False),
        (0, shown(0.0, periodicity=2), False),
        (1, shown(1.0, (0.1, 1.01 * BEATS * 0.1)), True),
        (1, shown(1.0, (0.1, -1.01 * BEATS * 0.1)), True),
        (1, shown(1.0, (-0.1, 0.99 * BEATS * 0.1)), False),
        (1, shown(2.0, (0.1, 9.0)), True),
        (1, shown(0.5, (0.1, 9.0)), False),
        (2, shown(1.0, (0.1, -0.1)), True),
        (2, shown(1.0, (0.0, -0.1)), False),
        (2, shown(1.0, (0.1, 0.0)), False),
        (2, shown(2.0, (0.1, -0.1)), False),
        (3, shown(0.5, periodicity=2), True),
        (3, shown(0.5), False),
        (3, shown(1.0, periodicity=2), False),
    ],
)
def test_motions_as_described(
    which: int, result: Any, is_shown: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lab_module, "strikes", lambda own: SimpleNamespace(mean=own.speeds))
    motion = MOTIONS[which]
    assert motion.is_shown_by(result) is is_shown
    for away, counts in ((0.0, True), (0.9 * SAME_FREQUENCY, True), (1.1 * SAME_FREQUENCY, False)):
        result.case = SimpleNamespace(period=1.0 / (motion.frequency + away))
        assert lab_module.is_as_described(result) is (is_shown and counts)


# ---- decisions


def decided(held: list[int], closed: list[int], hits: list[int]) -> tuple[list[int], int]:
    """Return the decisions on the last of three pairs, and how many are wrong."""
    n, start, step = len(held), 4.0, 0.25
    state = np.zeros((1, n, 4), dtype=np.int8)
    state[0, :, 3] = np.where(held, 2, 0)
    gap = np.ones((1, n, 4))
    gap[0, :, 3] = np.where(closed, 0.0, 1e-9)  # a gap of 0 is closed
    u = np.zeros((2, n, 4))
    u[1] = gap[0] - 1.0
    history = xr.Dataset(
        {
            "contact_state": (("frame", "node"), state[0]),
            "displacement": (("lamina", "frame", "node"), u),
            "gap0": ("node", np.ones(4)),
            "event_time": ("event", start + step * np.array(hits, dtype=float) + 1e-4),
            "event_node": ("event", np.full(len(hits), 3)),
        },
        {"frame": start + step * np.arange(n)},
    )
    result: Any = SimpleNamespace(history=history, case=SimpleNamespace(time_step=step))
    states, wrong = shapes.decisions(result)
    assert states.shape == (n - 1, 3) and (states[:, :2] == OPEN).all()
    return states[:, 2].tolist(), wrong


def test_decisions_of_one_pair() -> None:
    assert decided([0, 0, 0, 0], [0, 0, 0, 0], []) == ([OPEN, OPEN, OPEN], 0)
    assert decided([0, 1, 1, 0], [0, 1, 1, 0], [1]) == ([BEGUN, HELD, RELEASED], 0)
    assert decided([1, 1, 0, 0], [1, 1, 0, 0], []) == ([HELD, RELEASED, OPEN], 0)
    assert decided([0, 0, 0, 0], [0, 1, 1, 0], [1]) == ([STRUCK, SEPARATING, OPEN], 0)
    assert decided([0, 0, 1, 1], [0, 1, 1, 1], [1, 2]) == ([STRUCK, BEGUN, HELD], 0)


def test_decisions_that_break_the_rules_are_counted() -> None:
    assert decided([1, 1], [1, 0], [])[1] == 1  # held though open
    assert decided([1, 0], [1, 1], [])[1] == 1  # released though closed
    assert decided([1, 1], [1, 1], [1]) == ([BEGUN], 1)  # hit while it was held
    assert decided([0, 0], [0, 0], [1]) == ([STRUCK], 1)  # hit though open
    assert decided([0, 1], [0, 1], []) == ([SEPARATING], 1)  # begun without a hit
    assert decided([0, 1, 1, 1, 0], [0, 1, 0, 1, 1], [])[1] == 3


# ---- portraits


def test_harmonics_of_derivatives() -> None:
    n, period = 400, 0.25
    t = np.arange(1, n + 1) / n * 2.0  # two periods
    u = np.array([3.0 * np.sin(2 * np.pi * t) + 0.5 * np.cos(6 * np.pi * t), 0.0 * t])
    result: Any = SimpleNamespace(case=SimpleNamespace(period=period))
    harmonics = portraits._harmonics(u, 2, result)
    wanted = np.zeros(portraits.COUNTED)
    wanted[[0, 2]] = 3.0, 0.5
    rotation = 2.0 * np.pi / period * np.arange(1, portraits.COUNTED + 1)
    counted = harmonics["displacement"][0, : portraits.COUNTED]
    np.testing.assert_allclose(counted, wanted, atol=1e-9)
    np.testing.assert_allclose(harmonics["velocity"][0], wanted * rotation, atol=1e-6)
    np.testing.assert_allclose(harmonics["acceleration"][0], wanted * rotation**2, atol=1e-3)
    assert not harmonics["velocity"][1].any() or np.abs(harmonics["velocity"][1]).max() < 1e-9


def test_ratios_of_meshes_in_words() -> None:
    ratio = {"as printed": np.array([0.5, 1.5]), "other": np.array([0.7, 0.25])}
    assert portraits._band(ratio) == "0.50 … 0.70 / 0.25 … 1.50"
    thick, thin = portraits._finer(ratio)
    assert (thick.value, thick.within, thick.verdict) == (0.5, (0.5, 0.7), "holds")
    assert (thin.value, thin.within, thin.verdict) == (1.5, (0.25, 1.5), "undecided")
    assert judged(thick)[1].startswith("thick 0.5 (0.5 … 0.7), needs < 0.8")


def test_the_printed_number_may_lie_within_the_band() -> None:
    for factors, within in (((0.5, 1.5), (0.0, 0.5)), ((1.5, 1.25), (0.25, 0.5)),
                            ((0.5, 0.75), (0.25, 0.5)), ((1.0, 1.5), (0.0, 0.5))):  # fmt: skip
        for i in (0, 1):
            printed = np.array(portraits.PRINTED)
            numbers = Numbers({
                "d": {"displacement": 1.25 * printed},
                "d_by_gap_exponent": {k: factor * printed for k, factor in enumerate(factors)},
            })  # fmt: skip
            criterion = portraits._away(numbers, i)
            assert criterion.value == pytest.approx(0.25) and criterion.within == pytest.approx(
                within
            )


def test_only_the_left_panels_of_shapes_have_numbers_at_their_places() -> None:
    position, samples = np.zeros((2, 50, 5)), np.arange(len(shapes.PHASES))
    position[1] = 10.0 * np.sin(np.arange(50))[:, None]
    share = np.linspace(0.0, 1.0, 4)
    figure = shapes.draw_shapes(Numbers(
        {"share_closed": share, "share_near": share}, names=["thick", "thin"],
        x=np.arange(5.0), position=position, shown=samples,
    ))  # fmt: skip
    has = [any(label.get_text() for label in panel.get_yticklabels()) for panel in figure.axes]
    assert has == 2 * [True, False, False, False, False]
    assert not figure.legends[0].get_frame_on()
