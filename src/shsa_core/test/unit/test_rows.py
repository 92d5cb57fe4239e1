"""Rows of the table of substitutions as messages, and whom each of them concerns."""
from dataclasses import replace
from typing import Dict, List

import pytest
from shsa_msgs import msg
from substitute_driver import IN, OUT, row, signal

from shsa_core.errors import ShsaError
from shsa_core.model.error import Error
from shsa_core.model.kinds import OnPartition
from shsa_core.model.substitution import Substitution
from shsa_core.ros.wire.rows import own_rows, substitution_message, substitution_row

ROWS = (
    row(True, (IN, signal("/joint", None, None, "/left", "position[2]")), original="/node"),
    Substitution("/substitute_12", "s", (IN,), "y=x[0]", (OUT, OUT), ("f1", "f2"), 0.5),
    Substitution("/idle", "", (), "", ()),
    replace(row(), host="pi", on_partition=OnPartition.HEAL, yields=True),
    replace(row(), bridge=0.05),
    row(outputs=(replace(OUT, gain=1.2, offset=-0.5, error=Error(0.3, p95=0.7)),)),
)


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


def table(*rows: Substitution) -> Dict[str, msg.Substitution]:
    return {each.node or each.service: substitution_message(each) for each in rows}


PLAN = Substitution("", "warm", (IN,), "y=x[0]", (OUT,))
BUSY = Substitution("/substitute_a_1", "a", (IN,), "y=x[0]", (OUT,))
OTHER = replace(BUSY, node="/substitute_b_2", service="b")
IDLE = Substitution("/substitute_standby_3", "", (), "", ())
NEW = "/substitute_c_4"


def told(name: str, rows: Dict[str, msg.Substitution]) -> List[str]:
    """The rows that concern a substitute."""
    concerns = own_rows("/substitute_")(name)
    assert concerns is not None
    return [key for key, each in rows.items() if concerns(each, rows)]


def test_a_substitute_is_told_its_own_row_and_an_idle_one_the_plans_too() -> None:
    rows = table(PLAN, BUSY, OTHER, IDLE)
    assert told(BUSY.node, rows) == [BUSY.node]
    assert told(IDLE.node, rows) == ["warm", IDLE.node]
    assert told(NEW, rows) == ["warm"], "it has no row yet: it may be idle"
    rows.update(table(replace(IDLE, code="y=x[0]")))
    assert told(IDLE.node, rows) == [IDLE.node], "it is at work now"


@pytest.mark.parametrize(
    "name", ["/monitor", "/rostopic_1", "/ns/substitute_a_1", "/substitute_test"]
)
def test_whoever_is_no_substitute_of_ours_is_told_all(name: str) -> None:
    assert own_rows("/substitute_")(name) is None
