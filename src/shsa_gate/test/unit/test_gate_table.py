"""What a gate hears of the table of substitutions."""
from dataclasses import replace

from gate_stand import row
from shsa_msgs.msg import Substitutions

from shsa_core.model.error import Error
from shsa_core.ros.wire.rows import substitution_message
from shsa_gate.ros.gate import substitutions_changed


def test_a_gate_hears_by_how_much_a_substitute_may_err() -> None:
    outputs = tuple(replace(each, error=Error(0.5)) for each in row(True).outputs)
    sent = replace(row(True), outputs=outputs)
    table = Substitutions(substitutions=[substitution_message(sent)], whole=True)
    heard = substitutions_changed(table)
    assert heard.rows == (sent,) and heard.whole
