"""The exceptions of fault injection."""
from shsa_core.errors import ShsaError


class Refused(ShsaError):
    """A fault that is not made, as it cannot or must not be; the message says why."""
