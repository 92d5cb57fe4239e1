"""The way of an input's value, from the bytes on its connection to the lost topic's message."""
import os
import struct
import sys
import time
from dataclasses import fields, is_dataclass
from types import FrameType, SimpleNamespace
from typing import Any, List

import genpy
from std_msgs.msg import Float64
from substitute_driver import row
from test_inputs import SOURCE, Bench, a_bench, say

import shsa_core.errors
from shsa_core.ros.outputs import Outputs
from shsa_core.substitution import events
from shsa_core.substitution.machine import Substitute

__all__ = ["a_bench"]  # a fixture
PACKAGE = os.path.dirname(os.path.abspath(shsa_core.errors.__file__))
IN, OUT = "/in", "/out"
MOST_FILES = 8
LEAVES = "model/"
"""Functions there answer with a number, and hand nothing on."""
VALUE = 1234.5
BYTES = struct.pack("<d", VALUE)


def carries(what: Any, depth: int = 3) -> bool:
    """Tell whether something has the value in it, as a number or as bytes."""
    if isinstance(what, float):
        return what == VALUE
    if isinstance(what, (bytes, bytearray)):
        return BYTES in what
    if depth and isinstance(what, (tuple, list, dict)):
        each = what.values() if isinstance(what, dict) else what
        return any(carries(item, depth - 1) for item in each)
    if depth and is_dataclass(what):
        return any(carries(getattr(what, f.name), depth - 1) for f in fields(what))
    return isinstance(what, Float64) and what.data == VALUE


class Walk:
    """The functions of the package that the value is handed to, file by file."""

    def __init__(self) -> None:
        self.steps: List[str] = []

    def __enter__(self) -> "Walk":
        sys.setprofile(self._entered)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)

    def _entered(self, frame: FrameType, what: str, _: object) -> None:
        code = frame.f_code
        if what != "call" or not code.co_filename.startswith(PACKAGE):
            return
        names = code.co_varnames[: code.co_argcount]
        if any(carries(frame.f_locals.get(name)) for name in names if name != "self"):
            self.steps.append(f"{os.path.relpath(code.co_filename, PACKAGE)}:{code.co_name}")

    @property
    def files(self) -> List[str]:
        """Return the files, each as often as the value comes into it anew."""
        files = [step.split(":")[0] for step in self.steps]
        files = [file for file in files if not file.startswith(LEAVES)]
        return [file for file, before in zip(files, ["", *files]) if file != before]


def test_an_input_value_passes_few_files(bench: Bench) -> None:
    said: List[genpy.Message] = []
    publisher: Any = SimpleNamespace(publish=said.append)
    outputs = Outputs(lambda topic: None, lambda topic, consumer: None)
    outputs._publishers[OUT] = publisher
    core, now = Substitute(), time.monotonic
    carry: Any = {events.Compose: outputs.compose, events.Publish: outputs.publish}

    def tell(event: events.Event) -> None:
        for command in core.handle(event):
            carry.get(type(command), lambda _: None)(command)

    tell(events.RowChanged(now(), row(publishing=True), (), ros_time=0))
    tell(events.Advertised(now(), OUT))
    bench.listen(IN)
    bench.inputs.read([IN])
    say(bench.connect(IN, SOURCE), Float64(VALUE))
    bench.inputs.wait(5.0)
    with Walk() as walk:
        for event in bench.take(reads=True):
            tell(event)
        tell(events.Tick(now() + 0.02))
    assert said and said[-1].data == VALUE
    assert len(set(walk.files)) <= MOST_FILES, walk.steps
