"""Predicted errors of derivations: what is propagated, and what is not known."""
import pathlib
from dataclasses import replace
from math import hypot, pi, sqrt
from random import Random
from typing import Dict, List, Optional, Tuple

import numpy as np
import pytest

from shsa_core.codegen.prediction import P95, predictor
from shsa_core.files.ontology_file import read_ontology
from shsa_core.language.expression import parse_constraint, parse_law
from shsa_core.model.error import Error
from shsa_core.model.ontology import Constant, Ontology, Property, TransferFunction
from shsa_core.model.service import Provision, Service, Source
from shsa_core.search.derivation import Derivation, SourceTable
from shsa_core.search.best import BestDerivations

Range = Optional[Tuple[float, float]]


def law(
    output: str, text: str, error: Optional[Error] = None, quality: float = 1.0, name: str = ""
) -> TransferFunction:
    parsed = parse_law(text)
    inputs = tuple(each for each in parsed.names if each != "k")
    return TransferFunction(
        name or "to_" + output, output, inputs, parsed, quality, text=text, error=error
    )


def models(*functions: TransferFunction, **usual: Range) -> Ontology:
    names = dict.fromkeys(each for f in functions for each in (f.output, *f.inputs))
    properties = {name: Property(name, usual=usual.get(name)) for name in names}
    return Ontology(properties, {"k": Constant("k", 3.0)}, functions)


def sensor(
    name: str, error: Optional[Error], node: str = "", quality: float = 1.0, range: Range = None
) -> Source:
    provision = Provision(name, "data", range, quality, error=error)
    node = node or "/node_of_" + name
    service = Service(f"{name}{node}", "/" + name + node, "pkg/Type", node, 0.1, (provision,))
    return service.sources[0]


def derive(ontology: Ontology, name: str, *sources: Source) -> Derivation:
    """The best derivation from these sources alone."""
    best = BestDerivations(SourceTable(ontology.network, sources))
    number = ontology.network.number(name)
    assert best.settle(number)
    return best.ratings.derivation(number)


def expected(
    ontology: Ontology, name: str, *sources: Source, others: Tuple[Source, ...] = ()
) -> Optional[Error]:
    """Return the expected error of the best derivation; the SOM has `others` besides."""
    found = predictor(ontology, [*sources, *others])
    return None if found is None else found.of([derive(ontology, name, *sources)])[0]


def test_a_service_that_is_passed_on_has_its_own_error() -> None:
    error = Error(0.5, 0.1, 0.9, 0.02, 3.0, 10, "drive")
    assert expected(models(law("y", "x")), "x", sensor("x", error)) == error
    told = expected(models(law("y", "x")), "x", sensor("x", Error(0.5)))
    assert told == Error(0.5, p95=P95 * 0.5)


def test_nothing_is_predicted_where_nothing_is_known() -> None:
    ontology, plain = models(law("y", "x")), sensor("x", None)
    assert predictor(ontology, [plain]) is None
    # Figures elsewhere do not help.
    assert expected(ontology, "y", plain, others=(sensor("z", Error(1.0)),)) is None


def test_a_measured_relation_has_its_error_with_inputs_as_usual() -> None:
    error = Error(0.5, 0.1, 0.9, 0.02, 3.0, 10, "drive")
    ontology = models(law("y", "2*x", error))
    assert expected(ontology, "y", sensor("x", None)) == error
    assert expected(ontology, "y", sensor("x", Error(7.0))) == error
    assert expected(ontology, "y", sensor("x", Error(7.0)), others=(sensor("x", Error(8.0), "/m"),))


def test_an_input_that_is_worse_than_usual_adds_what_it_is_worse() -> None:
    ontology = models(law("y", "2*x", Error(0.5, delay=0.1)), x=(0.0, 1.0))
    usual = sensor("x", Error(0.3, delay=0.02), "/usual")
    worse = expected(ontology, "y", sensor("x", Error(0.5, delay=0.05)), others=(usual,))
    assert worse is not None
    assert worse.rms == pytest.approx(hypot(0.5, 2 * 0.4))
    assert worse.delay == pytest.approx(0.13) and worse.p95 == pytest.approx(P95 * worse.rms)
    # One whose error is not known is as good as usual only if none is known to be better.
    assert expected(ontology, "y", sensor("x", None), others=(usual,)) is None
    poor = sensor("x", None, quality=0.5)
    assert expected(ontology, "y", poor, others=(sensor("x", None, "/m"),)) is None
    assert expected(ontology, "y", poor) is not None


def test_exact_laws_pass_the_errors_of_their_inputs_on() -> None:
    ontology = models(law("y", "k*x - 2*z"), x=(0.0, 1.0), z=(0.0, 1.0))
    found = expected(ontology, "y", sensor("x", Error(0.3)), sensor("z", Error(0.4)))
    assert found is not None and found.rms == pytest.approx(hypot(0.9, 0.8))
    assert expected(ontology, "y", sensor("x", Error(0.3)), sensor("z", None)) is None


def test_a_relation_that_is_not_exact_and_has_no_figures_is_not_known() -> None:
    ontology = models(law("y", "x", quality=0.9), x=(0.0, 1.0))
    assert expected(ontology, "y", sensor("x", Error(0.3))) is None
    unknown = replace(ontology.functions[0], law=None, error=Error(1.0))
    other = Ontology(ontology.properties, {}, [unknown])
    assert expected(other, "y", sensor("x", Error(0.3))) is None


def test_what_has_one_cause_is_added_before_it_is_squared() -> None:
    """x comes in on two paths: its error partly cancels, where squares alone would add up."""
    parts = law("p", "3*x"), law("q", "2*x"), law("y", "p - q")
    ontology = models(*parts, x=(0.0, 1.0))
    found = expected(ontology, "y", sensor("x", Error(0.2)))
    assert found is not None and found.rms == pytest.approx(0.2)  # not hypot(0.6, 0.4)
    doubled = models(*parts[:2], law("y", "p + q"), x=(0.0, 1.0))
    found = expected(doubled, "y", sensor("x", Error(0.2)))
    assert found is not None and found.rms == pytest.approx(1.0)
    # So does the error of a relation whose result is used twice.
    twice = models(law("p", "x", Error(0.5)), law("q", "2*p"), law("y", "q - p"), x=(0.0, 1.0))
    found = expected(twice, "y", sensor("x", None))
    assert found is not None and found.rms == pytest.approx(0.5)


def test_two_paths_of_products_meet_in_one_point() -> None:
    """x**2 / x is x, whatever x is: the slopes of both paths are taken at the same values."""
    ontology = models(law("p", "x**2"), law("q", "1/x"), law("y", "p*q"), x=(2.0, 4.0))
    found = expected(ontology, "y", sensor("x", Error(0.01)))
    assert found is not None and found.rms == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize("text, bias", [("x + z", 0.5), ("x - z", -0.1), ("-x - z", -0.5)])
def test_biases_have_signs(text: str, bias: float) -> None:
    ontology = models(law("y", text), x=(0.0, 1.0), z=(0.0, 1.0))
    found = expected(ontology, "y", sensor("x", Error(0.2, 0.2)), sensor("z", Error(0.5, 0.3)))
    assert found is not None and found.bias == pytest.approx(bias)
    assert found.rms == pytest.approx(hypot(bias, 0.4))


def test_a_measured_relation_knows_the_bias_of_its_usual_input() -> None:
    ontology = models(law("y", "2*x", Error(0.5, 0.1)), x=(0.0, 1.0))
    usual = sensor("x", Error(0.2, 0.2), "/usual")
    found = expected(ontology, "y", sensor("x", Error(0.3, -0.3)), others=(usual,))
    assert found is not None and found.bias == pytest.approx(0.1 + 2 * (-0.3 - 0.2))


@pytest.mark.parametrize(
    "text", ["lowpass(x, 0.5)", "previous(x)", "delay(x, 0.2)", "lowpass(previous(x), 2)"]
)
def test_a_filter_does_not_make_an_error_smaller(text: str) -> None:
    """An error is slow until somebody shows that it is noise."""
    ontology = models(law("y", "2*" + text), x=(0.0, 1.0))
    found = expected(ontology, "y", sensor("x", Error(0.2)))
    assert found is not None and found.rms == pytest.approx(0.4)


@pytest.mark.parametrize("text", ["derivative(x)", "integral(x)", "x*dt"])
def test_what_depends_on_how_an_input_changes_has_no_figure_of_its_own(text: str) -> None:
    assert expected(models(law("y", text), x=(0.0, 1.0)), "y", sensor("x", Error(0.2))) is None
    measured = models(law("y", text, Error(0.5)), x=(0.0, 1.0))
    found = expected(measured, "y", sensor("x", Error(0.2)))
    assert found is not None and found.rms == 0.5, "unless it was measured"


def test_slopes_are_taken_where_values_usually_are() -> None:
    error = sensor("x", Error(0.01), range=(0.0, 10.0))
    found = expected(models(law("y", "x**2")), "y", error)
    assert found is not None and found.rms == pytest.approx(0.01 * 20.0 / sqrt(3.0), rel=0.01)
    found = expected(models(law("y", "x**2"), x=(1.0, 1.001)), "y", error)
    assert found is not None and found.rms == pytest.approx(0.02, rel=0.01)
    assert expected(models(law("y", "x**2")), "y", sensor("x", Error(0.01))) is None


def test_points_without_a_value_do_not_count() -> None:
    whole = replace(law("y", "sqrt(x)"), constraint=parse_constraint("x > 1"))
    found = expected(models(whole, x=(-2.0, 4.0)), "y", sensor("x", Error(0.01)))
    assert found is not None and found.rms == pytest.approx(0.0034, rel=0.1)
    few = replace(whole, constraint=parse_constraint("x > 3.9"))
    assert expected(models(few, x=(-2.0, 4.0)), "y", sensor("x", Error(0.01))) is None


def test_a_bend_is_as_wide_as_the_error() -> None:
    """|x| about 0: a derivative alone would say 1 or -1, and nothing in the middle."""
    ontology = models(law("y", "abs(x)"), x=(-1e-3, 1e-3))
    found = expected(ontology, "y", sensor("x", Error(1.0)))
    assert found is not None and found.rms < 0.01


def test_a_property_without_a_range_is_computed_of_those_that_have_one() -> None:
    ontology = models(law("p", "x + 1", Error(0.5)), law("y", "p**2"), x=(0.0, 0.001))
    found = expected(ontology, "y", sensor("x", None))
    assert found is not None and found.rms == pytest.approx(1.0, rel=0.01)
    usual = models(law("p", "derivative(x)", Error(0.5)), law("y", "p**2"), p=(2.0, 2.001))
    found = expected(usual, "y", sensor("x", None))
    assert found is not None and found.rms == pytest.approx(2.0, rel=0.01)


def test_the_baseline_of_a_property_is_told_along() -> None:
    ontology = models(law("p", "x", Error(0.5, baseline=4.0)), law("p", "2*z", name="by_z"))
    ontology = replace(ontology, properties={n: Property(n, usual=(0.0, 1.0)) for n in "pxz"})
    found = expected(ontology, "p", sensor("z", Error(0.5)))
    assert found is not None and (found.baseline, found.quality) == (4.0, 0.75)


def random_robot(random: Random) -> Tuple[Ontology, List[Source], Dict[str, Dict[str, float]]]:
    """Linear relations in two layers over four sensors, with their factors by output."""
    names = [f"s{i}" for i in range(4)]
    sources = [
        sensor(name, Error(hypot(bias, 0.5 * random.random() + 0.1), bias))
        for name in names
        for bias in [random.uniform(-0.3, 0.3)]
    ]
    functions, factors = [], {}
    for layer, outputs in enumerate((["p", "q", "r"], ["y"])):
        for output in outputs:
            inputs = random.sample(names, 3)
            factors[output] = {name: round(random.uniform(-2.0, 2.0), 2) for name in inputs}
            text = " + ".join(f"{factor}*{name}" for name, factor in factors[output].items())
            measured = layer == 0 and random.random() < 0.4
            error = Error(random.uniform(0.2, 0.8), random.uniform(-0.1, 0.1))
            functions.append(law(output, text, error if measured else None))
        names = names + outputs
    usual = {name: (0.0, 1.0) for name in names}
    return models(*functions, **usual), sources, factors


@pytest.mark.parametrize("seed", range(8))
def test_linear_derivations_err_as_is_predicted(seed: int) -> None:
    ontology, sources, factors = random_robot(Random(seed))
    noise, count = np.random.RandomState(seed), 40000
    errors = {each.property: each.provision.error for each in sources}
    for function in ontology.functions:
        errors[function.output] = function.error
    drawn: Dict[str, "np.ndarray[float, np.dtype[np.float64]]"] = {}

    def error_of(name: str) -> "np.ndarray[float, np.dtype[np.float64]]":
        if name not in drawn:
            error = errors[name]
            if error is None:
                parts = [k * error_of(each) for each, k in factors[name].items()]
                drawn[name] = np.sum(parts, axis=0)
            else:
                spread = sqrt(error.rms**2 - error.bias**2)
                drawn[name] = error.bias + spread * noise.standard_normal(count)
        return drawn[name]

    real = error_of("y")
    som = [each for each in sources if each.property in ontology.properties]
    found = expected(ontology, "y", *som)
    assert found is not None
    assert found.rms == pytest.approx(sqrt(float(np.mean(real**2))), rel=0.03)
    assert found.bias == pytest.approx(float(np.mean(real)), abs=0.03 * found.rms)
    assert found.p95 is not None
    assert 0.94 < float(np.mean(np.abs(real) <= found.p95)) <= 1.0


def test_the_same_question_has_the_same_answer() -> None:
    ontology = models(law("y", "sin(x)*z"), x=(0.0, pi), z=(1.0, 2.0))
    sources = sensor("x", Error(0.1)), sensor("z", Error(0.1))
    assert expected(ontology, "y", *sources) == expected(ontology, "y", *sources)


def test_values_on_the_way_and_tables_have_slopes(tmp_path: pathlib.Path) -> None:
    (tmp_path / "o.yaml").write_text(
        "properties: {x: {usual: [0, 1]}, y: , z: }\n"
        "relations:\n"
        "  way:\n"
        "    y: {where: {h: 2*x, g: h + x}, function: g - 1}\n"
        "  look:\n"
        "    z: table(x, -1, -4, 3, 12)\n"
    )
    ontology = read_ontology(str(tmp_path / "o.yaml"))
    for name, rms in (("y", 0.3), ("z", 0.4)):
        found = expected(ontology, name, sensor("x", Error(0.1)))
        assert found is not None and found.rms == pytest.approx(rms)
