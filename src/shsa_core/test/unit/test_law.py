"""A law is whatever says its inputs, units, ranges and code: here a relation by a table."""
from typing import List, Mapping, NamedTuple, Optional, Tuple

from search_models import source

from shsa_core.analysis.check import check_model
from shsa_core.codegen.plans import plan_service
from shsa_core.codegen.program import compile_program
from shsa_core.language.interval import Interval
from shsa_core.language.law import Law
from shsa_core.language.range_check import Trouble
from shsa_core.language.unit_check import Mismatch
from shsa_core.language.units import Unit, parse_unit
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.relation import TransferFunction
from shsa_core.search.derivation import SourceTable


class Steps(NamedTuple):
    """A table of two rows: one value below a limit, another one from there on."""

    names: Tuple[str, ...]
    limit: float
    values: Tuple[float, float]
    unit: str
    text: str = "two steps"
    entry: Mapping[str, str] = {}

    def mismatches(
        self, units: Mapping[str, Optional[Unit]], result: Optional[Unit]
    ) -> List[Mismatch]:
        return [] if result == parse_unit(self.unit) else [("the table gives another unit", True)]

    def troubles(
        self,
        ranges: Mapping[str, Interval],
        always: Optional[Mapping[str, Interval]] = None,
    ) -> List[Trouble]:
        inside = ranges[self.names[0]].low >= 0.0
        return [] if inside else [Trouble(self.names[0], "leaves the table")]

    def body(self, inputs: Mapping[str, str]) -> List[str]:
        low, high = self.values
        return [f"return {low} if {inputs[self.names[0]]} < {self.limit} else {high}"]


def robot(law: Law) -> Ontology:
    properties = {"charge": Property("charge", "1"), "voltage": Property("voltage", "V")}
    return Ontology(
        properties, {}, [TransferFunction("curve", "voltage", law.names, law, text=law.text)]
    )


def test_a_table_makes_a_substitute() -> None:
    ontology = robot(Steps(("charge",), 0.5, (11.5, 12.5), "V"))
    table = SourceTable(ontology.network, [source("charge")])
    plan = plan_service(ontology, source("voltage").service, table)
    step = compile_program(plan.program.code, 1, 1).step
    assert step((0.2,), 0.0) == (11.5,) and step((0.9,), 0.0) == (12.5,)


def test_a_table_is_checked_by_what_it_says_of_itself() -> None:
    assert check_model(robot(Steps(("charge",), 0.5, (11.5, 12.5), "V"))) == []
    (finding,) = check_model(robot(Steps(("charge",), 0.5, (11.5, 12.5), "A")))
    assert finding.what == "units of curve for voltage: the table gives another unit"
