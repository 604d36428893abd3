"""Dead reckoning, filter and smoother side by side: what has to hold between them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from loops import loop
from support import dataset

from slamcli.batch.closing import closing_step, head, returns
from slamcli.batch.compare import compare
from slamcli.batch.scaling import fit, scaling
from slamcli.errors import InputError, UsageError
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.run import run
from slamcli.formats.logs import read_log
from slamcli.reporting.comparison import (
    CSV_HEAD,
    comparison_document,
    comparison_summary,
    corrections_csv,
    scaling_document,
    scaling_summary,
)
from slamcli.reporting.documents import dumps
from slamcli.reporting.plots.comparison import draw_comparison
from slamcli.reporting.plots.style import house_style


@pytest.fixture(scope="module")
def found():
    return compare(loop(), EkfOptions())


def errors(comparison):
    return [method.against_truth.absolute["translation"].rmse for method in comparison.methods]


def test_smoother_beats_filter_beats_dead_reckoning():
    """In the mean over seeds; of a single drive each can be the lucky one."""
    quiet = {"robot": {"noise": [0.05, 0.05, 0.004]}}
    mean = np.mean([errors(compare(loop(seed=seed, **quiet), EkfOptions())) for seed in range(24)], axis=0)
    assert mean[2] < mean[1] <= mean[0]


def test_filter_moves_the_last_pose_only(found):
    closure = found.closure
    assert len(closure.filter.metres) == len(closure.smoother.metres) == closure.step + 1
    assert closure.filter.earlier == 0.0 < closure.filter.largest == closure.filter.metres[-1]
    assert closure.smoother.earlier > 0.0
    assert closure.smoother.moved > 0.2 > 0.02 > closure.filter.moved > 0.0
    assert closure.smoother.metres[0] == 0.0  # held


def test_closure_is_where_the_robot_comes_home(found):
    """The first pose that sees a landmark of the start again: everything behind it is the same closure."""
    log = found.log
    entry = log.observations[0]
    early = set(entry.landmarks[entry.steps < 20].tolist())
    again = entry.steps[np.isin(entry.landmarks, list(early)) & (entry.steps > 80)]
    assert found.closure.step == again.min()
    assert found.closure.absence > 60


def test_uncertainty_grows_while_driving_blind_and_shrinks_at_the_closure(found):
    deviation = np.sqrt(found.run.covariances[:, 0, 0] + found.run.covariances[:, 1, 1])
    step = found.closure.step
    assert deviation[20] < deviation[40] < deviation[60]
    assert deviation[step] < 0.5 * deviation[step - 1]
    smoother = np.sqrt(found.methods[2].covariances[:, 0, 0] + found.methods[2].covariances[:, 1, 1])
    assert smoother[step - 1] < deviation[step - 1]
    assert smoother.max() < deviation.max()


@pytest.mark.parametrize("choice", ["last", "largest"])
def test_choices_of_a_closure(found, choice):
    log, options = found.log, found.options
    step = closing_step(log, options, found.run, choice)
    seen = returns(log, found.run.assignments)
    assert step in seen.steps
    assert closing_step(log, options, found.run, int(log.ids[step])) == step
    if choice == "last":
        assert step == seen.steps[seen.onsets][-1]


def test_a_pose_without_a_reading_closes_nothing(found):
    blind = np.setdiff1d(np.arange(len(found.log)), found.log.observations[0].steps)
    with pytest.raises(UsageError, match="closes no loop"):
        closing_step(found.log, found.options, found.run, int(found.log.ids[blind[0]]))
    with pytest.raises(UsageError, match="no pose has the id 9999"):
        closing_step(found.log, found.options, found.run, 9999)


def test_without_a_closure_it_says_so():
    comparison = compare(head(loop(), 60, 60), EkfOptions())
    assert comparison.closure is None
    assert "there is no loop closure" in "\n".join(comparison_summary(comparison))
    assert comparison_document(comparison)["closure"] is None
    with house_style():
        assert len(draw_comparison(comparison).axes) == 2


def test_without_truth_it_says_so():
    comparison = compare(replace(loop(), true_trajectory=None, true_landmarks=None), EkfOptions())
    text = "\n".join(comparison_summary(comparison))
    assert "there is no truth: no ATE" in text and "ATE m" not in text and "NEES" not in text.split("note")[0]
    assert [method["absolute"] for method in comparison_document(comparison)["methods"]] == [None] * 3


def test_landmarks_alone_can_have_a_truth():
    comparison = compare(replace(loop(), true_trajectory=None), EkfOptions())
    text = "\n".join(comparison_summary(comparison))
    assert "landmarks m" in text and "ATE m" not in text
    known = compare(loop(), EkfOptions())
    for one, other in zip(comparison.methods, known.methods, strict=True):
        assert one.landmark_errors.error.rmse == pytest.approx(other.landmark_errors.error.rmse)


def test_without_a_landmark_there_is_nothing_to_compare():
    with pytest.raises(InputError, match="no reading was taken for a landmark"):
        compare(loop(), EkfOptions(sensor_range=0.01))


def test_another_frame_is_said_and_moved():
    log = loop()
    turned = replace(log, start=np.array([5.0, -3.0, 1.0]))
    comparison = compare(turned, EkfOptions())
    assert any("--align origin" in note for note in comparison.notes)
    for align in ("origin", "se"):
        moved, plain = compare(turned, EkfOptions(), align=align), compare(log, EkfOptions(), align=align)
        assert errors(moved) == pytest.approx(errors(plain), rel=1e-6)
        assert (moved.methods[1].against_truth.consistency is None) == (align == "se")


def test_a_truth_without_headings_has_no_nees():
    log = loop()
    flat = log.true_trajectory.poses.copy()
    flat[:, 2] = 0.0
    comparison = compare(replace(log, true_trajectory=replace(log.true_trajectory, poses=flat)), EkfOptions())
    assert comparison.methods[1].against_truth.consistency is None
    assert "the truth has no headings: no NEES" in comparison.notes


def test_a_truth_of_positions_is_aligned():
    log = replace(loop(), positions_only=True)
    comparison = compare(log, EkfOptions())
    assert comparison.align == "se" and any("aligned by se" in note for note in comparison.notes)
    assert errors(comparison) == pytest.approx(errors(compare(loop(), EkfOptions(), align="se")))
    assert "ATE deg" not in "\n".join(comparison_summary(comparison))


def test_agreement_is_none_of_both_where_they_are_one(found):
    agreement = found.agreement
    assert 0.0 < agreement.last_pose < agreement.path
    assert 0.0 <= agreement.inside <= 1.0 < 100.0 * agreement.landmarks


def test_csv_has_a_row_for_each_pose(found):
    lines = corrections_csv(found.closure).decode().splitlines()
    assert lines[0] == CSV_HEAD
    rows = np.array([line.split(",") for line in lines[1:]], dtype=np.float64)
    assert (rows[:, 0] == found.log.ids[: found.closure.step + 1]).all()
    assert (rows[:-1, 1] == 0.0).all() and rows[-1, 1] == found.closure.filter.largest
    assert (rows[:, 2] == found.closure.smoother.metres).all()


def test_document(found):
    document = json.loads(dumps(comparison_document(found)))
    assert [method["name"] for method in document["methods"]] == ["dead reckoning", "filter", "smoother"]
    assert [method["absolute"]["translation"]["rmse"] for method in document["methods"]] == errors(found)
    size = 3 + 2 * document["landmarks"]
    assert document["methods"][1]["memory_bytes"] == 8 * size * size
    assert document["methods"][2]["memory_bytes"] == 8 * document["smoother"]["sparsity"]["nnz_factor"]
    assert document["closure"]["filter"]["earlier"] == 0.0
    assert document["methods"][1]["nees"]["count"] == len(found.log) - 1  # the first pose is known


def test_summary_has_a_row_for_each_method(found):
    lines = comparison_summary(found)
    for name in ("dead reckoning", "filter", "smoother"):
        assert sum(line.startswith(f"{name}  ") for line in lines) >= 1
    assert any(f"loop closure at pose {found.log.ids[found.closure.step]} " in line for line in lines)


def test_figure_has_three_panels(found):
    with house_style():
        figure = draw_comparison(found)
        figure.draw_without_rendering()
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "y (m)",
        "deviation of the position (m)",
        "moved by the closure (m)",
    ]
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["dead reckoning", "filter", "smoother", "truth", "95 % region", "loop closure"]
    low, high = figure.axes[0].get_xlim()
    assert low < found.methods[2].poses[:, 0].min() and high > found.methods[2].poses[:, 0].max()


def test_unknown_association_is_that_of_the_filter():
    log = loop(robot={"noise": [0.02, 0.02, 0.002]})
    options = EkfOptions(association="nearest")
    comparison = compare(log, options)
    result = run(log, options)
    assert comparison.smoothed.result.dof == comparison.smoothed.built.graph.degrees_of_freedom()
    assert len(comparison.smoothed.landmarks) == len(result.landmarks)
    assert errors(comparison)[2] < 1.0


def test_exponents():
    x = np.array([100.0, 200.0, 400.0, 800.0])
    assert fit(x, 3e-9 * x**2).exponent == pytest.approx(2.0, abs=1e-12)
    assert fit(x, 3e-9 * x**2).error == pytest.approx(0.0, abs=1e-12)
    bent = fit(x, 1.0 + x**2 / 1e4)
    assert bent.exponent < bent.last < 2.0 and bent.error > 0.01
    assert fit(x[:2], x[:2]).error is None
    noisy = np.exp([0.1, -0.1, -0.1, 0.1])  # orthogonal to the slope: sum of squares 0.04, 2 degrees of freedom
    assert fit(x, x * noisy).exponent == pytest.approx(1.0)
    assert fit(x, x * noisy).error == pytest.approx(np.sqrt(0.02 / (5.0 * np.log(2.0) ** 2)))


def test_scaling_counts_what_it_says():
    measured = scaling([60, 30])
    assert [point.landmarks for point in measured.points] == sorted(point.landmarks for point in measured.points)
    for point in measured.points:
        assert point.filter_bytes == 8 * (3 + 2 * point.landmarks) ** 2
        assert point.smoother_bytes == 8 * point.nnz_factor
        assert point.updates >= 5 and point.update_seconds > 0.0
    assert 1.7 < measured.fits["filter_bytes"].exponent < 2.0
    assert measured.fits["smoother_bytes"].exponent < 1.3
    assert len(scaling_document(measured)["scaling"]) == 2
    assert any("N to the power" in line for line in scaling_summary(measured))


@pytest.mark.parametrize("counts", [[30], [30, 30], [5, 30]])
def test_scaling_needs_two_worlds(counts):
    with pytest.raises(UsageError, match="at least two numbers"):
        scaling(counts)


def test_victoria_park():
    """First-estimates Jacobians take the filter to the smoother's optimum; standard ones leave it far off."""
    log = read_log(str(dataset("landmark2d/victoriaPark_from_isam.g2o")))
    first = compare(log, EkfOptions(jacobians="first-estimates"))
    assert first.smoothed.result.final_chi2 == pytest.approx(6184.120626, abs=1e-4)
    assert first.agreement.landmarks < 1.0 and first.agreement.inside > 0.9
    standard = compare(log, EkfOptions(), closure="largest")
    assert standard.agreement.landmarks > 10.0
    assert standard.closure.filter.earlier == 0.0 < standard.closure.smoother.earlier


def test_first_return_of_a_short_log_begins_a_closure():
    """Five poses are fewer than the calm before a closure."""
    log = head(loop(), 4, 4)
    entry = log.observations[0]
    kept = np.flatnonzero((entry.steps == 0) | (entry.steps == 4))[[0, -1]]
    assert entry.steps[kept].tolist() == [0, 4]
    seen = replace(
        entry,
        steps=entry.steps[kept],
        landmarks=np.array([7, 7]),
        measurements=entry.measurements[kept],
        information=entry.information[kept],
    )
    log = replace(log, observations=[seen])
    assert closing_step(log, EkfOptions(), run(log, EkfOptions()), "last") == 4
