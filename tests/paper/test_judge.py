"""Verdicts follow from numbers: a changed number changes its verdict, and nothing is drawn."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from copy import copy
from typing import Any

import numpy as np
import pytest
from project import ROOT

from delam_fem.paper import parameters, portraits, responses
from delam_fem.paper.claims import Claim, Criterion, Numbers, Verdict, judged, yes
from delam_fem.paper.portraits import NARROW, SCATTERS, WIDE
from delam_fem.paper.reproduce import FIGURES
from delam_fem.paper.runs import Effort, Laboratory, motion_case
from delam_fem.studies.executors import Serial

PLAN = Effort(thresholds=2)


@pytest.fixture(scope="module")
def lab() -> Iterator[Laboratory]:
    yield Laboratory(PLAN, Serial())


def verdicts(name: str, lab: Laboratory) -> dict[str, str]:
    piece = FIGURES[name]
    return {claim.text: claim.verdict for claim in piece.judge(piece.measure(lab))}


def but(numbers: Numbers, **changes: Any) -> Numbers:
    """Return numbers with some others in their place."""
    changed = copy(numbers)
    vars(changed).update(changes)
    return changed


def test_numbers_of_the_picture_are_not_written() -> None:
    numbers = Numbers({"written": 1}, drawn=2)
    assert (numbers.written, numbers.drawn, numbers.kept) == (1, 2, {"written": 1})


# -- criteria ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "relation", "within", "verdict"),
    [
        (0.4, "<", None, "holds"),
        (0.6, "<", None, "does not hold"),
        (0.5, ">", None, "does not hold"),
        (0.5, "=", None, "holds"),
        (0.4, "<", (0.3, 0.45), "holds"),
        (0.4, "<", (0.3, 0.55), "undecided"),
        (0.6, "<", (0.45, 0.7), "undecided"),
        (0.6, "<", (0.55, 0.7), "does not hold"),
        (0.6, ">", (0.55, 0.7), "holds"),
        (float("nan"), "<", None, "does not hold"),
    ],
)
def test_a_criterion_is_undecided_where_its_bound_is_uncertain(
    value: float, relation: Any, within: tuple[float, float] | None, verdict: Verdict
) -> None:
    assert Criterion("n", value, relation, 0.5, "", within).verdict == verdict


def test_a_verdict_is_that_of_the_worst_criterion_and_states_all() -> None:
    good = Criterion("share", 0.13, "<", 0.5, "%")
    unsure = Criterion("e", 0.08, "<", 0.1, "", (-0.01, 0.226))
    bad = Criterion("distance", 0.034, "<", 0.005, "Hz")
    assert judged(good) == ("holds", "share 13, needs < 50 %")
    verdict, margin = judged(good, unsure)
    assert (verdict, margin.split("; ")[1]) == (
        "undecided",
        "e 0.08 (-0.01 … 0.226), needs < 0.1",
    )
    assert judged(unsure, good, bad)[0] == "does not hold"
    assert judged(yes("as described", False)) == ("does not hold", "as described: no")
    assert Claim("1", "t", "s", "m", *judged(bad)).row[-2:] == (
        "distance 0.034, needs < 0.005 Hz",
        "does not hold",
    )


# -- changed numbers --------------------------------------------------------------------------


def motion(frequency: float, **changes: Any) -> Callable[[Any], Any]:
    """Return a change of a motion by method 3.2 in the numbers of Figs. 3 and 12."""
    key = (frequency, "3.2")
    return lambda n: but(n, motions={**n.motions, key: but(n.motions[key], **changes)})


def entry(name: str, **changes: Any) -> Callable[[Any], Any]:
    """Return a change of entries of a dictionary among the numbers."""
    return lambda n: but(n, **{name: {**getattr(n, name), **changes}})


def to(**changes: Any) -> Callable[[Any], Any]:
    """Return a change of numbers."""
    return lambda n: but(n, **changes)


def long_contacts(share: float) -> Callable[[Any], Any]:
    """Return a change of the contact phases of all motions in Fig. 3."""
    return lambda n: but(n, motions={key: but(m, near_share=share) for key, m in n.motions.items()})


def scattering(scatter: float) -> Callable[[Any], Any]:
    """Return a change of the scatter of cycles in Fig. 9."""
    return lambda n: but(n, motion=but(n.motion, strobe_scatters=[scatter] * 8))


def settled(periods: int, least: int, most: int) -> Callable[[Any], Any]:
    """Return a change of the length of transients in Fig. 9."""
    by_scatters = {WIDE: [5, 5, 5, least], NARROW: [most, 5, 5, 5]}
    return to(settled_by_scatters=by_scatters | {SCATTERS: [5, 5, 5, periods]})


def ratios(printed: float, others: float) -> Callable[[Any], Any]:
    """Return a change of the roughness in Fig. 14, as printed and with the other schemes."""
    return lambda n: but(
        n, ratio={k: np.full(2, printed if k == "as printed" else others) for k in n.ratio}
    )


NOT_SO = {"is_as_described": False}
YES: Verdict = "holds"
NO: Verdict = "does not hold"
UNDECIDED: Verdict = "undecided"
CHANGES: list[tuple[str, str, Callable[[Any], Any], Verdict]] = [
    ("1", "the ratio of masses", to(mass_ratio=0.51), YES),
    ("1", "E and the sections", to(stiffness_over_EbH3_12=[1.0, 1.1]), NO),
    ("3", "1.25 Hz: almost harmonic", motion(1.25, distortion_factor=[0.0, 0.02]), NO),
    ("3", "1.25 Hz: weak contacts", to(weakness=0.5), NO),
    ("3", "1.25 Hz: weak contacts", to(reach=0.6), NO),
    ("3", "1.60 Hz: the thin lamina", motion(1.6, **NOT_SO), NO),
    ("3", "3.25 Hz: the thick beats", motion(3.25, **NOT_SO), NO),
    ("3", "3.25 Hz gives the maximum", to(approach={1.25: 0, 1.6: 2, 3.25: 1, 3.65: 1}), NO),
    ("3", "3.65 Hz: period doubling", motion(3.65, **NOT_SO), NO),
    ("3", "1.60 … 3.65 Hz: the interval", long_contacts(0.2), YES),
    ("3", "1.60 … 3.65 Hz: the interval", long_contacts(0.05), NO),
    ("4", "the contact duration", to(share_closed=np.full(20, 0.02)), NO),
    ("5", "thick nearly harmonic", entry("thd", displacement=np.array([0.01, 0.05])), NO),
    ("5", "velocities and accelerations", entry("d", velocity=np.zeros(2)), NO),
    ("7", "a force peak", to(lowest_period_ms=1.0), NO),
    ("7", "no snap-back in the time", to(restitution_after_peak=-0.1), NO),
    ("7", "the strain wave decays", to(peak_wave_strain_max_exact=[2.0, 1.0]), NO),
    ("7", "the mean wave velocity", to(mean_wave_speed_m_s=5000.0), NO),
    ("8", "0 ≤ e ≤ 0.1", to(restitution_by_samples={1: 0.3, 2: 0.25}), NO),
    ("8", "0 ≤ e ≤ 0.1", to(restitution_by_samples={1: 0.08, 2: 0.01}), YES),
    ("8", "0 ≤ e ≤ 0.1", to(restitution_by_samples={1: 0.08, 2: 0.16}), UNDECIDED),
    ("9", "Δt = T/1000", scattering(0.2), NO),
    ("9", "Δt = T/1000", scattering(0.09), UNDECIDED),
    ("9", "some hundred periods", settled(101, 100, 120), YES),
    ("9", "some hundred periods", settled(99, 90, 99), NO),
    ("9", "some hundred periods", settled(101, 90, 120), UNDECIDED),
    ("10", "permanent contact is captured", to(impacts_per_period=[0.5, 9.0]), NO),
    ("10", "the time history", to(roughness_displacement=(1.0, 0.0)), NO),
    ("11", "each closed pair", to(violations=1), NO),
    ("12", "all four motions", motion(1.25, **NOT_SO), NO),
    ("12", "in all cases", motion(1.6, strobe_scatter=None), NO),
    ("12", "3.2 is distinctly smoother", lambda n: but(n, roughness_free={
        (f, m): (1.0, 1.0) if m == "3.1" else (0.7, 0.7) for f, m in n.roughness_free}), YES),
    ("13", "permanent contact makes", to(ratio=np.array([0.5, 0.5])), YES),
    ("13", "permanent contact makes", to(ratio=np.array([0.5, 0.9])), NO),
    ("14", "50 elements: considerably", ratios(0.5, 0.6), YES),
    ("14", "50 elements: considerably", ratios(0.5, 0.9), UNDECIDED),
    ("14", "a substantial increase", to(cost=1.0, cost_within=(0.9, 1.1)), NO),
    ("14", "a substantial increase", to(cost=2.0, cost_within=(1.8, 2.1)), YES),
    ("gamma", "γ is close to", to(largest_tip_gap_rate_m_s=5.0), NO),
    ("gamma", "the central difference", to(central_difference_steps_per_period=900.0), YES),
]  # fmt: skip


@pytest.mark.parametrize(("name", "text", "change", "verdict"), CHANGES)
def test_a_changed_number_changes_its_verdict(
    lab: Laboratory, name: str, text: str, change: Callable[[Any], Any], verdict: Verdict
) -> None:
    piece = FIGURES[name]
    numbers = piece.measure(lab)
    before, after = (
        next(claim for claim in piece.judge(n) if claim.text.startswith(text))
        for n in (numbers, change(numbers))
    )
    assert after.verdict == verdict
    # where the change keeps the verdict, another row of the table changes it
    tried = {row[3] for row in CHANGES if row[:2] == (name, text)}
    assert {YES, NO} <= {before.verdict, *tried}
    assert before.margin and after.margin


def test_what_holds_of_the_motions(lab: Laboratory) -> None:
    outcomes = verdicts("3", lab) | verdicts("12", lab)
    assert outcomes["3.65 Hz: period doubling, one contact in two periods"] == "holds"
    assert outcomes["3.25 Hz gives the maximum strike of all"] == "holds"
    assert outcomes["all four motions with one set of parameters"] == "holds"
    assert outcomes["3.2 is distinctly smoother than 3.1 in free vibration"] == "does not hold"


def test_tip_on_a_block_is_judged(lab: Laboratory) -> None:
    outcomes = verdicts("7", lab)
    assert len(outcomes) == 6 and outcomes.pop("strong energy dissipation during the contact") == NO
    assert set(outcomes.values()) == {"holds"}


def test_bands_say_whether_the_printed_value_is_inside(lab: Laboratory) -> None:
    orders = dict.fromkeys(portraits.ORDERS, np.array([0.003, 0.02]))
    bands = {"1": [0.0020, 0.05], "2": [0.0034, 0.02], "3": [0.0046, 0.04]}
    numbers = but(portraits.measure(lab), d=orders, thd=orders, d_by_gap_exponent=bands)
    thick, thin, *_ = portraits.SPECTRA.judge(numbers)
    assert "0.20 … 0.46 % for gaps (x/L)^p, p = 1 … 3 (the printed value is outside" in (
        thick.measured
    )
    assert "2.00 … 5.00 %" in thin.measured and "is inside" in thin.measured
    assert (thick.verdict, thin.verdict) == (NO, UNDECIDED)


def response_numbers() -> Numbers:
    """Return a response that the paper describes."""
    flat = np.array([3.4, 3.7]), np.ones((2, 2))
    return Numbers(
        {},
        frequency_hz=np.array([3.4, 3.5, 3.6, 3.7]),
        amplitude_up_m=np.ones((2, 4)),
        amplitude_down_m=np.ones((2, 4)),
        periodicity_up=np.array([1.0, 7.0, 2.0, 2.0]),
        periodicity_down=np.array([1.0, np.nan, 2.0, 2.0]),
        tip_contacts_per_period=np.array([[1.0, 1.4, 0.5, 0.5]] * 2),
        hysteresis_hz=np.array([3.5]),
        jumps_up_hz=[[3.45], []],
        jumps_down_hz=[[], [3.45]],
        largest_amplitude_m=np.array([0.025, 0.03]),
        largest_amplitude_at_hz=[3.5, 3.5],
        largest_swept_amplitude_m={},
        linear_peak_m=np.array([0.25, 0.25]),
        case=motion_case(3.25, PLAN),
        envelopes={"up": flat, "down": flat},
        marked_m=np.zeros((4, 2)),
    )


def test_response_is_judged_by_its_numbers() -> None:
    numbers = response_numbers()
    rows = {claim.text: claim for claim in responses.WITH_CONTACT.judge(numbers)}
    assert {claim.verdict for claim in rows.values()} == {"holds"}
    scenario = rows["a bifurcation scenario with different numbers of impacts in a period"]
    assert scenario.measured == (
        "periods 1, 2, 7, none up to 8 at 3.50 Hz, 0.5 to 1.4 tip contacts per period; up and "
        "down differ at 3.50 Hz; jumps at 3.45 Hz"
    )
    one_motion = but(numbers, periodicity_up=np.ones(4), periodicity_down=np.ones(4))
    assert [claim.verdict for claim in responses.WITH_CONTACT.judge(one_motion)] == [
        "holds", "does not hold", "does not hold",
    ]  # fmt: skip


def test_doubled_window_is_the_one_about_the_frequency() -> None:
    f = np.array([3.0, 3.2, 3.4, 3.6, 3.8, 4.0])
    up, down = np.array([2, 1, 2, 2, 2, 1]), np.array([2, 1, 1, 2, 2, 2])
    numbers = but(response_numbers(), frequency_hz=f, periodicity_up=up, periodicity_down=down)
    assert responses.doubled_window(numbers, 3.65) == (3.6, 3.8)
    assert responses.doubled_window(numbers, 3.2) is None


def linear_numbers() -> Numbers:
    """Return linear responses that the paper describes."""
    names = ("linear, up", "linear, down")
    return Numbers(
        {},
        natural_frequency_hz=[3.17, 1.47],
        exact_peak_hz=[3.17, 1.47],
        exact_peak_m=[0.1, 0.1],
        frequency_rise_at_peak=[0.001, 0.001],
        damping_ratio=[0.008, 0.008],
        sweep_peak_hz={name: [3.18, 1.46] for name in names},
        sweep_peak_m={name: np.array([0.09, 0.09]) for name in names},
        stepped_frequency_hz=np.zeros(1),
        stepped_amplitude_m=np.zeros((2, 1)),
        stepped_over_exact=np.ones((2, 1)),
        largest_deviation_of_stepped=0.0,
        case=motion_case(3.25, PLAN),
        envelopes=dict.fromkeys(names, (np.zeros(1), np.zeros((2, 1)))),
        record=(np.zeros(1), np.zeros((2, 2, 1))),
    )


@pytest.mark.parametrize(
    ("failing", "change"),
    [
        (None, to()),
        (0, to(natural_frequency_hz=[3.1649, 1.4357])),
        (1, entry("sweep_peak_hz", **{"linear, up": [3.18, 1.44]})),
        (2, entry("sweep_peak_m", **{"linear, up": np.array([0.09, 0.08])})),
        (3, to(frequency_rise_at_peak=[0.001, 0.005])),
    ],
)
def test_linear_response_is_judged_by_its_numbers(
    failing: int | None, change: Callable[[Any], Any]
) -> None:
    outcomes = [
        claim.verdict for claim in responses.WITHOUT_CONTACT.judge(change(linear_numbers()))
    ]
    assert outcomes == ["does not hold" if k == failing else "holds" for k in range(4)]


def plane_numbers(one_periodic: float, spread: float) -> Numbers:
    """Return a plane with a share of one-periodic points and a spread of the amplitudes."""
    return Numbers(
        {},
        share={"one-periodic": one_periodic, "higher order": 1.0 - one_periodic},
        one_periodic_by_threshold=dict.fromkeys(parameters.TOLD_THRESHOLDS, one_periodic),
        one_contact_share=0.95,
        amplitude_spread=np.full(2, spread),
        amplitude_by_first=np.array([0.8, 0.8]),
        amplitude_by_second=np.array([0.1, 0.1]),
    )


def decade(share: float, with_undecided: float, thin_spread: float) -> Numbers:
    """Return the best decade of the damping, with a share of one-periodic points."""
    return Numbers(
        {"from": 0.1},
        one_periodic=share,
        one_periodic_within=(share, with_undecided),
        amplitude_spread=np.array([0.4, thin_spread]),
    )


def planes(impact: Numbers, best: Numbers) -> Numbers:
    """Return the planes of both laws."""
    return Numbers({}, impact=impact, classical=plane_numbers(0.2, 0.5), best_decade=best)


def impact(**changes: Any) -> Callable[[Any], Any]:
    """Return a change of the plane of method 3.2."""
    return lambda n: but(n, impact=but(n.impact, **changes))


@pytest.mark.parametrize(
    ("failing", "change"),
    [
        (None, to()),
        (0, impact(share={"one-periodic": 0.45})),
        (1, impact(one_contact_share=0.8)),
        (2, impact(amplitude_by_second=np.array([0.1, 0.9]))),
        (3, to(best_decade=decade(0.9, 0.9, 0.4))),
        (3, to(best_decade=decade(0.4, 0.4, 0.05))),
    ],
)
def test_planes_are_judged_by_their_numbers(
    failing: int | None, change: Callable[[Any], Any]
) -> None:
    numbers = planes(plane_numbers(0.8, 0.1), decade(0.4, 0.4, 0.4))
    outcomes = [claim.verdict for claim in parameters.PLANES.judge(change(numbers))]
    assert outcomes == ["does not hold" if k == failing else "holds" for k in range(4)]


def test_a_plane_without_one_periodic_points_is_no_scale() -> None:
    none = but(plane_numbers(0.8, 0.1), share={"one-periodic": 0.0, "higher order": 1.0})
    *_, sensitive = parameters.PLANES.judge(planes(none, decade(0.4, 0.4, 0.4)))
    assert sensitive.verdict == "does not hold"


def test_undecided_points_make_a_share_uncertain() -> None:
    unsure = plane_numbers(0.4, 0.1)
    unsure = but(unsure, share={"one-periodic": 0.4, "undecided": 0.3})
    robust, *_, sensitive = parameters.PLANES.judge(planes(unsure, decade(0.35, 0.45, 0.4)))
    assert robust.verdict == sensitive.verdict == "undecided"
    assert robust.margin == "one-periodic 40 (40 … 70), needs > 50 %"


# -- without matplotlib -----------------------------------------------------------------------

WITHOUT_MATPLOTLIB = """
import json
import sys

sys.modules["matplotlib"] = None  # an import of it fails

from delam_fem.paper.runs import Effort, Laboratory
from delam_fem.paper.reproduce import FIGURES
from delam_fem.system.files import json_ready
from delam_fem.studies.executors import Serial

lab = Laboratory(Effort(periods=45, thresholds=2, gap_exponents=(1.0, 2.0)), Serial())
for name in sys.argv[1:]:
    piece = FIGURES[name]
    numbers = piece.measure(lab)
    claims = piece.judge(numbers)
    assert claims and all(claim.figure == name for claim in claims), claims
    assert json.dumps(json_ready(numbers.kept, 7))
    try:
        piece.draw(numbers)
    except ModuleNotFoundError:
        print(name)
"""


@pytest.mark.slow
def test_numbers_and_verdicts_need_no_matplotlib() -> None:
    slow = {"2a", "2b", "5", "6", "14", "15", "gamma"}  # their modules are imported, as all are
    names = [name for name in FIGURES if name not in slow]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_MATPLOTLIB, *names],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == names
