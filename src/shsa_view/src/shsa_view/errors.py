"""What the view refuses."""
from shsa_core.errors import ShsaError


class Refused(ShsaError):
    """What was asked for is not done; `status` is that of the HTTP answer."""

    def __init__(self, text: str, status: int = 400) -> None:
        super().__init__(text)
        self.status = status
