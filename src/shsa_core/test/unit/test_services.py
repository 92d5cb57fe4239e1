"""Questions of people to the core: whatever goes wrong, who asked is told at once."""
from typing import Any, Callable

import pytest

from shsa_core.errors import ShsaError
from shsa_core.ros import services, settings
from shsa_core.ros.services import Services
from shsa_core.ros.workers import Workers


@pytest.fixture(name="asking")
def _asking(monkeypatch: Any) -> Services:
    monkeypatch.setattr(settings, "ANSWER_S", 30.0)
    monkeypatch.setattr(services, "charge_also", lambda _: None)
    found = object.__new__(Services)
    found._enqueue = Workers("core", failed=lambda _: None).put
    return found


def broken(error: Exception) -> Callable[[], Any]:
    def question() -> Any:
        raise error

    return question


def test_an_answer_is_returned(asking: Services) -> None:
    assert asking._ask(lambda: 7) == 7


@pytest.mark.parametrize(
    "error, told",
    [
        (ShsaError("there is none"), "^there is none$"),
        (OSError(28, "No space left on device"), "^OSError: .*No space left on device"),
        (KeyError("x"), "^KeyError: 'x'"),
    ],
)
def test_an_error_is_told(asking: Services, error: Exception, told: str) -> None:
    with pytest.raises(ShsaError, match=told):
        asking._ask(broken(error))
