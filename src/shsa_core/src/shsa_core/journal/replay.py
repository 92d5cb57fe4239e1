"""Makes the decisions of a journal again, one by one."""
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Iterator, Optional, Tuple

from shsa_core.errors import ModelError
from shsa_core.journal.lines import SILENCE, Answer, digest
from shsa_core.journal.reader import Journal


@dataclass(frozen=True)
class Step:
    """One event and what the machine says to it now.

    `seconds`: how long that took. `then`: what it answered when it was recorded, None: unknown.
    `error`: what it raised. `broken`: the invariant that does not hold after the event.
    """

    where: str
    event: Any
    commands: Tuple[Any, ...]
    seconds: float
    now: Answer
    then: Optional[Answer]
    error: str = ""
    broken: str = ""

    @property
    def differs(self) -> bool:
        """Whether the answer is another one than was recorded."""
        return self.then is not None and self.then != self.now


def replay(journal: Journal) -> Iterator[Step]:
    """The decisions of a journal, made again by a new machine.

    Raises ModelError if the journal is not valid.
    """
    try:
        machine = journal.kind.make(**journal.setup)
    except Exception as raised:  # whatever it is, it comes from this setup
        raise ModelError(journal.path, f"the setup makes no machine: {raised!r}") from raised
    validate = getattr(machine, "validate", None)
    for where, event, then in journal.entries():
        commands: Tuple[Any, ...] = ()
        failed = broken = ""
        begun = perf_counter()
        try:
            commands = tuple(machine.handle(event))
        except Exception as raised:  # as the nodes do, which go on after whatever it was
            failed = repr(raised)
        seconds = perf_counter() - begun
        if validate is not None:
            try:
                validate()
            except Exception as raised:
                broken = str(raised) or repr(raised)
        now = digest(journal.kind.commands, commands) if commands else SILENCE
        yield Step(where, event, commands, seconds, now, then, failed, broken)
