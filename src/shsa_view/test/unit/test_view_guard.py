"""Access to the view."""
import pytest
from shsa_view.facts import presence
from shsa_view.guard import HEADERS, host_allowed, token_given


@pytest.mark.parametrize(
    "header",
    ["localhost", "LOCALHOST:8080", "127.0.0.1:8080", "[::1]:8080", "10.0.0.7", "Robot:80"],
)
def test_addresses_and_our_own_names_are_allowed(header: str) -> None:
    assert host_allowed(header, ["robot"])


@pytest.mark.parametrize("header", ["", "evil.example", "evil.example:8080", "[::1", "robot.evil"])
def test_names_that_others_give_us_are_not(header: str) -> None:
    assert not host_allowed(header, ["robot"])


def test_a_token_is_given_whole() -> None:
    assert token_given("Bearer abc", "abc")
    for wrong in ("Bearer ab", "abc", "bearer abc", "", "Bearer ", "Bearer äbc"):
        assert not token_given(wrong, "abc")
    assert not token_given("Bearer ", "")


def test_nothing_is_loaded_from_elsewhere() -> None:
    assert HEADERS["Content-Security-Policy"].startswith("default-src 'self'")


def test_a_healer_is_there_while_it_is_connected_and_heard() -> None:
    assert presence(True, True, None)[0] == presence(True, True, 1.0)[0] == "alive"
    assert presence(True, True, 60.0) == ("lost", "it has said nothing for 60 s")
    assert presence(False, True, None)[0] == "lost"
    assert presence(False, False, None)[0] == "unknown"
