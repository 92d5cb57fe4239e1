"""Runs a tool of the project, and looks for what it leaves behind."""
import os
import subprocess
import uuid

from shsa_testing.processes import marked

MARK = "SHSA_TEST"


def run_tool(*words: str, timeout: float) -> "subprocess.CompletedProcess[str]":
    """Run a tool, both of its outputs in one.

    Raises AssertionError, with what it said, if one of its processes has not ended with it.
    """
    mark = uuid.uuid4().hex
    done = subprocess.run(
        words,
        env={**os.environ, MARK: mark},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
        timeout=timeout,
    )
    assert not marked(MARK, mark), done.stdout
    return done
