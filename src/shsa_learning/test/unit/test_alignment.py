"""Past samples are held, later ones never; duplicates; what may be an input for a target."""
import math
from dataclasses import replace
from typing import Any, List, Sequence

import numpy as np
import pytest

from recordings import som_of
from shsa_core.errors import ShsaError
from shsa_core.model.som import Som
from shsa_learning.learn.evaluation import evaluate
from shsa_learning.learn.features import function_of
from shsa_learning.learn.inputs import duplicates, offer
from shsa_learning.learn.rows import gather
from shsa_learning.recordings.recording import Recording, Series, held, largest_age

RNG = np.random.RandomState(7)


def series(time: Any, values: Any, name: str = "v", source: str = "", **more: str) -> Series:
    return Series(
        name, source or name, more.pop("node", ""), np.array(time), np.array(values), **more
    )


def noisy(n: int = 400, step: float = 0.1, seed: int = 0) -> Series:
    time = step * np.arange(n)
    return series(time, np.sin(time) + 0.1 * np.random.RandomState(seed).randn(n))


def test_a_sample_holds_from_its_time_on_and_never_before() -> None:
    time = np.array([0.0, 0.99, 1.0, 1.5, 2.0, 3.0])
    found = held(series([1.0, 2.0], [5.0, 6.0]), time)
    np.testing.assert_array_equal(found, [math.nan, math.nan, 5.0, 5.0, 6.0, 6.0])


def test_a_future_sample_changes_nothing_before_it() -> None:
    past = noisy()
    other = past.values.copy()
    other[200:] += 100.0
    later = series(past.time, other)
    time = np.arange(0.0, 19.9999, 0.013)
    np.testing.assert_array_equal(held(past, time), held(later, time))


def test_a_sample_that_is_too_old_or_no_number_is_no_value() -> None:
    time = np.array([0.5, 1.0, 1.25, 1.26, 2.0, 2.5])
    found = held(series([1.0, 2.0], [5.0, math.inf]), time, age=0.25)
    assert np.isnan(found).tolist() == [True, False, False, True, True, True]


def test_the_largest_age_is_that_of_a_substitute() -> None:
    som = som_of(
        fast={**_service("/fast"), "period": 0.01},
        slow={**_service("/slow"), "period": 1.0, "deadline": 3.0},
        door={**_service("/door"), "period": "none"},
    )
    ages = [largest_age(series([0.0, 7.0], [0.0, 1.0], service=each), som) for each in som.services]
    assert ages == [0.25, 3.0, math.inf]
    assert largest_age(series([0.0, 0.1, 0.2], [0.0, 1.0, 2.0])) == pytest.approx(0.5)


def _fields(given: Any) -> dict:
    topic, type_, node, fields = given
    provides = {name: {"field": field} for name, field in fields.items()}
    return {"topic": topic, "type": type_, "node": node, "provides": provides}


def _service(topic: str) -> dict:
    provides = {topic[1:]: {"field": "data"}}
    return {"topic": topic, "type": "std_msgs/Float64", "node": topic, "provides": provides}


@pytest.mark.parametrize("period, rate", [(0.1, 0.8), ("none", math.inf)])
def test_a_derivative_is_by_when_its_input_was_measured_and_turns_as_a_substitutes(
    period: Any, rate: float
) -> None:
    """An angle of 10 Hz beside a gyroscope of 50 Hz; one that is event-driven holds instead."""
    yaw = {"heading": {"field": "yaw(pose.pose.orientation)"}}
    odometry = {"topic": "/odom", "type": "nav_msgs/Odometry", "node": "/wheels", "provides": yaw}
    gyroscope = ("/gyro", "std_msgs/Float64", "/gyro", {"rate": "data"})
    som = som_of(odom={**odometry, "period": period}, gyro={**_fields(gyroscope), "period": 0.02})
    time, slow = np.arange(0.0, 30.0, 0.02), np.arange(5.0, 30.0, 0.1)
    turned = np.angle(np.exp(0.8j * slow))
    measured = series(time, 0.8 + 0.0 * time, "rate", "/gyro/data", service="gyro")
    heading = series(slow, turned, "heading", "/odom/yaw(pose/pose/orientation)", service="odom")
    drive = Recording("drive", (measured, heading))
    table = gather([drive, drive], "rate", ("heading",), som).table
    said = evaluate(function_of("rate", "derivative(heading)"), {}, table)
    known = said[np.isfinite(said)]
    assert len(known) > 2 * 1200
    if rate < math.inf:
        np.testing.assert_allclose(known, rate, rtol=1e-6)
    else:
        assert sorted(set(np.round(known, 6))) == [0.0, 4.0]  # as it comes, by the rows


def test_a_gap_and_what_has_not_begun_have_no_value() -> None:
    time = np.r_[np.arange(2.0, 5.0, 0.1), np.arange(7.0, 9.0, 0.1)]
    slow = series(time, time)
    moments = np.arange(0.0, 10.0, 0.01)
    found = held(slow, moments, largest_age(slow))
    known = moments[np.isfinite(found)]
    assert known[0] == pytest.approx(2.0) and known[-1] == pytest.approx(9.4, abs=0.011)
    (end,) = np.flatnonzero(np.diff(known) > 1.0)
    assert known[end] == pytest.approx(5.4, abs=0.011)  # five intervals after the last
    assert known[end + 1] == pytest.approx(7.0)


@pytest.mark.parametrize("gain, offset", [(1.0, 0.0), (2.5, -7.0), (-0.001, 0.0)])
@pytest.mark.parametrize("stride", [1, 4])
@pytest.mark.parametrize("late", [0.0, 0.03, 0.1])
def test_the_same_values_in_other_words_are_found(
    gain: float, offset: float, stride: int, late: float
) -> None:
    one = noisy()
    other = series(one.time[::stride] + late, (gain * one.values + offset)[::stride], "w")
    for pair in ([one, other], [other, one]):
        (same,) = duplicates([*pair, noisy(seed=5)])
        assert {same.first, same.second} == {one, other}
        ratio = gain if same.first is one else 1.0 / gain
        assert same.gain == pytest.approx(ratio, rel=1e-4)


def test_a_copy_in_single_precision_with_lost_samples_is_found() -> None:
    one = noisy()
    kept = np.sort(RNG.permutation(len(one))[: int(0.995 * len(one))])
    other = series(one.time[kept], one.values.astype(np.float32)[kept], "w")
    assert "w of w has the values of v of v" in str(duplicates([one, other])[0])


def test_two_sensors_of_one_thing_are_no_duplicates() -> None:
    assert not duplicates([noisy(seed=1), noisy(seed=2)])
    constant = series(np.arange(50.0), np.ones(50))
    assert not duplicates([constant, constant, series(np.arange(5.0), np.arange(5.0))])


def recording(*parts: Series) -> Recording:
    return Recording("drive", parts)


def of(service: str, seed: int, name: str = "", node: str = "") -> Series:
    found = noisy(seed=seed)
    return Series(
        name or service, f"/{service}", node or f"/{service}", found.time, found.values, service
    )


def why(parts: Sequence[Series], som: object = None) -> List[str]:
    """Return why each but the first may not be an input for the first; empty: it may."""
    offered = offer(recording(*parts), parts[0], som)  # type: ignore[arg-type]
    reasons = {id(each.series): each.why for each in offered.left_out}
    return [reasons.get(id(each), "") for each in parts[1:]]


def test_the_targets_own_source_is_no_input() -> None:
    target = series([0.0, 1.0], [1, 2], "v", "drive.csv")
    same = series([0.0, 1.0], [1, 2], "w", "drive.csv")
    again = series([0.0, 1.0], [1, 2], "v", "other.csv")
    apart = series([0.0, 1.0], [1, 2], "u", "other.csv")
    reasons = why([target, same, again, apart])
    assert "the same source as the target, drive.csv" in reasons[0]
    assert "the target, measured once more" in reasons[1]
    assert reasons[2] == ""


def test_what_fails_with_the_target_is_no_input() -> None:
    som = som_of(
        v={**_service("/v"), "fails_with": ["hub"]},
        w={**_service("/w"), "fails_with": ["hub"]},
        u=_service("/u"),
    )
    som = Som(replace(each, host="pi") for each in som)  # of one computer much can be learned
    reasons = why([of("v", 1), of("w", 2), of("u", 3), of("t", 4, node="/v")], som)
    assert reasons == [
        "it fails with the target: hub",
        "",
        "it is of /v, which is lost with the target",
    ]


def test_what_is_derived_from_the_target_is_no_input_by_however_many_steps() -> None:
    som = som_of(
        v=_service("/v"),
        w={**_service("/w"), "derived_from": ["/v"]},
        u={**_service("/u"), "derived_from": ["w"]},
        free=_service("/free"),
    )
    assert som.services["u"].upstream == ("w", "v")
    reasons = why([of("v", 1), of("w", 2), of("u", 3), of("free", 4)], som)
    assert reasons[:2] == [
        "it is derived from the target: w is computed from v",
        "it is derived from the target: u is computed from v",
    ]
    assert reasons[2] == ""


def test_what_the_target_is_computed_from_is_an_input_and_that_is_said() -> None:
    som = som_of(v={**_service("/v"), "derived_from": ["w"]}, w=_service("/w"))
    parts = of("v", 1), of("w", 2)
    offered = offer(recording(*parts), parts[0], som)
    assert offered.inputs == (parts[1],)
    assert offered.notes == ("v is computed from w of /w (/w): that is what is learned",)


def test_what_both_derive_from_each_other_is_no_input() -> None:
    som = som_of(
        v={**_service("/v"), "derived_from": ["w"]}, w={**_service("/w"), "derived_from": ["v"]}
    )
    assert "derived from the target" in why([of("v", 1), of("w", 2)], som)[0]


def test_a_duplicate_of_the_target_is_no_input() -> None:
    target = of("v", 1)
    copy = Series("w", "/w", "/w", target.time + 0.02, 3.0 * target.values, "w")
    assert "it is a duplicate: w of /w (/w) is 3 * (v of /v (/v))" in why([target, copy])[0]


def test_an_input_that_is_asked_for_is_found_or_the_reason_is_told() -> None:
    target, copy, free = of("v", 1), of("v", 2, "w"), of("u", 3)
    offered = offer(recording(target, copy, free), target)
    assert offered.of("u") is free
    with pytest.raises(ShsaError, match="w may not be an input for v: it is of the same source"):
        offered.of("w")
    with pytest.raises(ShsaError, match="t was not recorded beside v of /v .*; there is u"):
        offered.of("t")


def test_no_service_is_derived_from_itself() -> None:
    for name in ("v", "/v"):
        with pytest.raises(AssertionError, match="v cannot be derived from itself"):
            som_of(v={**_service("/v"), "derived_from": [name]})
