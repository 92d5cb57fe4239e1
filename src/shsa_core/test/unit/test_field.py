"""The grammar of fields: read, written, and nothing else taken for one."""
import math
import string

import pytest
from hypothesis import given, strategies as st

from shsa_core.errors import ShsaError
from shsa_core.model.field import (
    ANGLES,
    REDUCTIONS,
    FieldText,
    Named,
    Span,
    Step,
    parse_field,
    is_distance,
    to_path,
)
from shsa_core.model.field_value import REDUCE, angles, quaternion

LETTERS = string.ascii_letters
NAMES = st.builds(str.__add__, st.sampled_from(LETTERS), st.text(LETTERS + "_09", max_size=5))
PLACES = st.integers(0, 999_999)
ITEMS = st.text(string.ascii_letters + string.digits + "_./:-", min_size=1, max_size=20)
STEPS = st.builds(Step, NAMES, st.one_of(st.none(), PLACES, st.builds(Named, NAMES, ITEMS)))
SPANS = st.one_of(
    st.none(),
    st.builds(Span, st.integers(1, 999), st.none()),
    st.builds(Span, st.integers(0, 99), st.integers(100, 999_999)),
)
PATHS = st.lists(STEPS, min_size=1, max_size=4).map(lambda steps: tuple(steps))
FIELDS = st.one_of(
    st.builds(FieldText, PATHS, st.sampled_from(("", *ANGLES))),
    st.builds(
        lambda before, last, function: FieldText((*before, last), function),
        st.lists(STEPS, max_size=3),
        st.builds(Step, NAMES, SPANS),
        st.sampled_from(REDUCTIONS),
    ),
)


@given(FIELDS)
def test_a_field_is_read_as_it_was_written_in_both_forms(field: FieldText) -> None:
    text = str(field)
    assert parse_field(text) == field
    assert parse_field(to_path(text), "/") == field
    assert not set(text) & set(", '\"\\\n\0$;`=") - {"="}


@given(st.text(max_size=30))
def test_whatever_is_read_is_written_the_same_way_again(text: str) -> None:
    try:
        field = parse_field(text)
    except ShsaError:
        return
    assert parse_field(str(field)) == field


@pytest.mark.parametrize(
    "text, path",
    [
        ("twist.twist.linear.x", "twist/twist/linear/x"),
        ("ranges[3]", "ranges[3]"),
        ("velocity[name=left_wheel]", "velocity[name=left_wheel]"),
        ("pose[name=base::link.1/a-b].position.x", "pose[name=base::link.1/a-b]/position/x"),
        ("min(scan.ranges[10:50])", "min(scan/ranges[10:50])"),
        ("yaw(pose.pose.orientation)", "yaw(pose/pose/orientation)"),
    ],
)
def test_what_stands_in_the_three_strings(text: str, path: str) -> None:
    assert to_path(text) == path
    assert str(parse_field(path, "/")) == text


def test_all_of_an_array_is_written_without_a_slice() -> None:
    assert {str(parse_field(f"mean(ranges{part})")) for part in ("", "[:]", "[0:]")} == {
        "mean(ranges)"
    }
    assert str(parse_field("mean(ranges[:5])")) == "mean(ranges[:5])"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a.",
        "a..b",
        "a/b",
        "1a",
        "_a",
        "a[]",
        "a[-1]",
        "a[1][2]",
        "a[1234567]",
        "a[1:2]",
        "a[b=c]d",
        "a[b=]",
        "a[b=c,d]",
        "a[b='c']",
        "a[b=c]]",
        "a[b:=c]",
        "a[b=c d]",
        "a[b=\u00e4]",
        "\u00e4",
        "a\n",
        "a[b=c\n]",
        "min()",
        "min(a[3])",
        "min(a[5:5])",
        "min(a[7:5])",
        "min(a[1:2].b)",
        "min(min(a))",
        "min(a).b",
        "yaw(a[1:2])",
        "yaw(a",
        "sum(a)",
        "__import__(os)",
        "min (a)",
        "min(a, b)",
        "a[b=" + "c" * 101 + "]",
        ".".join("a" * 200),
    ],
)
def test_what_is_no_field_is_refused(text: str) -> None:
    with pytest.raises(ShsaError, match="field"):
        parse_field(text)


def test_distances_tell_of_nothing_and_other_numbers_do_not() -> None:
    for field in ("ranges[0]", "min(ranges)", "mean(ranges[1:5])"):
        assert is_distance("sensor_msgs/LaserScan", field)
    assert is_distance("sensor_msgs/Range", "range")
    assert not is_distance("sensor_msgs/LaserScan", "scan_time")
    assert not is_distance("sensor_msgs/Range", "max_range")
    assert not is_distance("std_msgs/Float64MultiArray", "ranges[0]")


@pytest.mark.parametrize(
    "values, smallest, largest, mean, count",
    [
        ([3.0, 1.0, 2.0], 1.0, 3.0, 2.0, 3),
        ([3.0, math.nan, math.inf, 1.0], 1.0, 3.0, 2.0, 2),
        ([3.0, -math.inf], -math.inf, 3.0, 3.0, 1),
        ([math.inf, math.inf], math.inf, math.inf, math.inf, 0),
        ([math.inf, math.nan], math.inf, math.inf, math.inf, 0),
        ([-math.inf], -math.inf, -math.inf, -math.inf, 0),
        ([math.nan], math.nan, math.nan, math.nan, 0),
        ([], math.nan, math.nan, math.nan, 0),
        (b"\x01\x03", 1.0, 3.0, 2.0, 2),
    ],
)
def test_reductions(values: list, smallest: float, largest: float, mean: float, count: int) -> None:
    found = [REDUCE[name](values) for name in REDUCTIONS]
    assert all(isinstance(each, float) for each in found)
    assert str(found) == str([smallest, largest, mean, float(count)])


ANGLE = st.floats(-3.1, 3.1)


@given(ANGLE, st.floats(-1.5, 1.5), ANGLE, st.floats(0.01, 100.0))
def test_angles_come_back_from_their_quaternion(
    roll: float, pitch: float, yaw: float, length: float
) -> None:
    x, y, z, w = (length * each for each in quaternion(roll, pitch, yaw))
    assert angles(x, y, z, w) == pytest.approx((roll, pitch, yaw), abs=1e-6)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_looking_straight_up_or_down_yaw_is_still_known(pitch: float) -> None:
    assert angles(*quaternion(0.0, pitch, 0.7)) == pytest.approx((0.0, pitch, 0.7), abs=1e-6)


def test_quaternions_as_rep_103_has_them() -> None:
    half = math.sqrt(0.5)
    assert angles(0.0, 0.0, half, half) == pytest.approx((0.0, 0.0, math.pi / 2))  # to the left
    assert angles(half, 0.0, 0.0, half) == pytest.approx((math.pi / 2, 0.0, 0.0))
    assert angles(0.0, 0.5, 0.0, math.sqrt(0.75)) == pytest.approx((0.0, math.pi / 3, 0.0))


@pytest.mark.parametrize("part", [0.0, math.nan, math.inf, 1e-9, 1e200])
def test_what_is_no_rotation_has_no_angles(part: float) -> None:
    assert all(map(math.isnan, angles(part, 0.0, 0.0, part)))
