"""Rows of the table of substitutions as messages, and a reader whom only its own rows concern."""
from dataclasses import replace
from io import BytesIO

import genpy
import pytest
from shsa_msgs.msg import Substitutions
from std_msgs.msg import Header
from substitute_driver import IN, OUT, row, signal

from shsa_core.errors import ShsaError
from shsa_core.model.error import Error
from shsa_core.model.kinds import OnPartition
from shsa_core.model.substitution import Substitution
from shsa_core.ros.wire.rows import only_rows_of, substitution_message, substitution_row

ROWS = (
    row(True, (IN, signal("/joint", None, None, "/left", "position[2]")), original="/node"),
    Substitution("/substitute_12", "s", (IN,), "y=x[0]", (OUT, OUT), ("f1", "f2"), 0.5),
    Substitution("/idle", "", (), "", ()),
    replace(row(), host="pi", on_partition=OnPartition.HEAL, yields=True),
    replace(row(), bridge=0.05),
    row(outputs=(replace(OUT, gain=1.2, offset=-0.5, error=Error(0.3, p95=0.7)),)),
)


def encoded(**of: object) -> bytes:
    """A table as bytes."""
    header = Header(seq=7, stamp=genpy.Time(3, 4), frame_id="map")
    buffer = BytesIO()
    Substitutions(header=header, sequence=2**40, **of).serialize(buffer)
    return buffer.getvalue()


@pytest.mark.parametrize("each", ROWS)
def test_a_row_survives_the_way_as_a_message(each: Substitution) -> None:
    assert substitution_row(substitution_message(each)) == each


def test_a_row_that_says_of_a_cut_what_nobody_knows_is_refused() -> None:
    message = substitution_message(row())
    message.on_partition = "flee"
    with pytest.raises(ShsaError, match="on_partition must be one of heal, wait, not 'flee'"):
        substitution_row(message)
    message.on_partition = ""
    assert substitution_row(message).on_partition is OnPartition.WAIT


@pytest.mark.parametrize("whole", [True, False])
def test_rows_of_others_are_not_decoded_but_counted(whole: bool) -> None:
    rows = [substitution_message(each) for each in ROWS]
    data = encoded(whole=whole, substitutions=rows, removed=["/substitute_2"])
    message = only_rows_of("/substitute_123", lambda: False)().deserialize(data)
    assert (message.sequence, message.whole) == (2**40, whole)
    assert (message.substitutions, message.removed) == ([], [])
    assert message.header == Substitutions().deserialize(data).header


@pytest.mark.parametrize("node", ["/substitute_1", "/substitute_12", "/idle", "/substitute_2"])
def test_a_table_that_names_the_reader_is_decoded(node: str) -> None:
    rows = [substitution_message(each) for each in ROWS]
    data = encoded(substitutions=rows, removed=["/substitute_2"])
    message = only_rows_of(node, lambda: False)().deserialize(data)
    assert [substitution_row(each) for each in message.substitutions] == list(ROWS)
    assert message.removed == ["/substitute_2"]


def test_the_reader_subscribes_the_type_of_the_table() -> None:
    reader = only_rows_of("/idle", lambda: False)
    assert (reader._type, reader._md5sum) == (Substitutions._type, Substitutions._md5sum)
