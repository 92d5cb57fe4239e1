"""Findings: what the checks of a model report."""
from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One thing that a check found: where (file and line), what, and what to do.

    `level` is error or warning.
    """

    level: str
    where: str
    what: str
    todo: str = ""

    def __str__(self) -> str:
        text = f"{self.where}: {self.level}: {self.what}"
        if not self.todo:
            return text
        return f"{text}{'' if text.endswith('?') else '.'} {self.todo}."
