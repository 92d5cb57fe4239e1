"""Refusals of the view."""
from shsa_core.errors import ShsaError


class Refused(ShsaError):
    """A request is refused; `status` is that of the HTTP answer."""

    def __init__(self, text: str, status: int = 400) -> None:
        super().__init__(text)
        self.status = status
