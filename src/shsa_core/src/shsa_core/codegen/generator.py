"""Generates a substitute's three strings from derivations (Section V-A3 of the paper)."""
import re
from contextlib import suppress
from functools import lru_cache
from hashlib import sha1
from typing import Dict, List, Mapping, NamedTuple, Sequence, Tuple, Union

from shsa_core.codegen.checked_code import check_code
from shsa_core.errors import CodeError, ExpressionError, GenerationError, listed
from shsa_core.language.expression import Condition, Law, parse_law
from shsa_core.model.calibration import Calibration
from shsa_core.model.ontology import Constant, TransferFunction
from shsa_core.model.service import Provision, Service, Source
from shsa_core.model.substitution import Program
from shsa_core.search.derivation import Derivation, Rated, rate_function

NAMES = ("first", "second", "third")
"""Of what is fused, as the law calls it; so many at most."""
_FUSION = re.compile(r"(fusion [\d:]+): (.+)")
_INPUT = re.compile(r"\bi([123])\b")
_DEFINITION = re.compile(r"def (\w+)\(.*\): # (.+)")
_RESULT = re.compile(r"(\w+)=(?:(\w+)?\((.*)\)|(\w+))")
Use = Tuple[str, str, Tuple[str, ...]]
"""A relation used in a generated program: its title, its result, the `way` of each input."""


def generate(
    derivations: Sequence[Tuple[Derivation, str]], constants: Mapping[str, Constant]
) -> Program:
    """Return the program that computes each derivation for its output path, in order.

    Each input is read and each relation computed once. Raises GenerationError, by name.
    """
    nodes = in_order([derivation for derivation, _ in derivations])
    inputs = {_place(source): i for i, source in enumerate(inputs_of([d for d, _ in derivations]))}
    variables: Dict[int, str] = {}
    computed: Dict[Tuple[str, str, Tuple[str, ...]], str] = {}
    lines: List[str] = []
    if inputs:
        lines.append(" ".join(f"t{i}=x[{i}];" for i in range(len(inputs))))
    for node in nodes:
        if node.source is not None:
            variables[id(node)] = f"t{inputs[_place(node.source)]}"
        elif node.function is not None:
            arguments = tuple(variables[id(child)] for child in node.inputs)
            use = (node.function.relation, node.function.output, arguments)
            if use not in computed:
                computed[use] = f"t{len(inputs) + len(computed)}"
                name = f"_tf{len(computed)}"
                lines += _definition(name, node.function, constants)
                lines.append(f"{computed[use]}={name}({','.join(arguments)})")
            variables[id(node)] = computed[use]
    results = ",".join(variables[id(derivation)] for derivation, _ in derivations)
    lines.append(f"y={results}" if len(derivations) == 1 else f"y=({results})")
    code = "\n".join(lines) + "\n"
    try:
        check_code(code, len(inputs), len(derivations))
    except CodeError as error:
        names = list(dict.fromkeys(n.function.relation for n in nodes if n.function))
        raise GenerationError(f"no code for the relations {listed(names)}: {error}") from error
    return Program(tuple(path for path, _ in inputs), code, tuple(path for _, path in derivations))


def way(derivation: Derivation) -> str:
    """Return the same text for derivations by the same relations of the same values."""
    ways: Dict[Derivation, str] = {}
    for node in in_order([derivation]):
        function = node.function
        if node.source is not None:
            ways[node] = node.source.path
        elif function is not None:
            ways[node] = _way(_title(function), [ways[each] for each in node.inputs])
    return ways[derivation]


def ways_of(program: Program) -> Tuple[str, ...]:
    """Return the `way` of each output of a generated program; nothing if it is another one."""
    return uses_of(program)[1]


@lru_cache(maxsize=1000)
def uses_of(program: Program) -> Tuple[Tuple[Use, ...], Tuple[str, ...]]:
    """Return what a generated program uses, and the `way` of each of its outputs."""
    ways = {f"t{i}": path for i, path in enumerate(program.inputs)}
    definitions: Dict[str, Tuple[str, str]] = {}
    uses: List[Use] = []
    name = ""
    for line in program.code.splitlines():
        definition, result = _DEFINITION.match(line), _RESULT.fullmatch(line)
        if definition is not None:
            name = definition[1]
            definitions[name] = definition[2], ""
        elif result is not None:
            names = [name for name in (result[3] or result[4] or "").split(",") if name]
            inputs = [ways.get(name, "") for name in names]
            if result[1] == "y":
                return tuple(uses), tuple(inputs)
            title, text = definitions.get(result[2], ("", ""))
            ways[result[1]] = _way(title, inputs)
            uses.append((title, text, tuple(inputs)))
        elif name in definitions:
            definitions[name] = definitions[name][0], line.strip()
    return (), ()


def _way(title: str, inputs: Sequence[str]) -> str:
    return sha1(f"{title} of {inputs}".encode()).hexdigest()


def _title(function: TransferFunction) -> str:
    return f"{function.relation}: {function.output}"


class Fusion(NamedTuple):
    """A weighted sum of derivations of its output, by errors measured together; the `way` of each.

    It is a function as any other, by a relation that is named after the shares.
    """

    function: TransferFunction
    ways: Tuple[str, ...]


def fuse(derivations: Sequence[Derivation], parts: Sequence[Tuple[float, Calibration]]) -> Fusion:
    """Return the fusion of derivations of a property: the sum of their shares, calibrated."""
    words = ":".join(f"{100.0 * share:.0f}" for share, _ in parts)
    sum_ = " + ".join(f"{s * each.gain:.6g}*{name}" for name, (s, each) in zip(NAMES, parts))
    text = f"{sum_} {sum(share * each.offset for share, each in parts):+.6g}"
    ways = tuple(way(derivation) for derivation in derivations)
    return Fusion(function_of(f"fusion {words}", derivations[0].property, text), ways)


@lru_cache(maxsize=1000)
def fusions_of(program: Program) -> Tuple[Fusion, ...]:
    """Return the fusions that a generated program computes."""
    found: List[Fusion] = []
    for title, result, ways in uses_of(program)[0]:
        named = _FUSION.fullmatch(title)
        if named is not None:
            text = _INPUT.sub(lambda i: NAMES[int(i[1]) - 1], result.replace("return ", ""))
            with suppress(ExpressionError):
                each = Fusion(function_of(named[1], named[2], text), ways)
                found += [each] if each.function.inputs == NAMES[: len(each.ways)] else []
    return tuple(found)


def function_of(relation: str, output: str, text: str) -> TransferFunction:
    """Return the function of a relation that is not in the ontology."""
    law = parse_law(text)
    return TransferFunction(relation, output, law.names, law, text=law.text)


def fused(fusions: Sequence[Fusion], parts: Sequence[Rated]) -> List[Rated]:
    """Return the fusions of some derivations of a property of which all parts are there."""
    by_way: Dict[str, Rated] = {}
    for rated in parts if fusions else ():
        by_way.setdefault(way(rated.derivation), rated)
    return [
        rate_function(each.function, 0, [by_way[one] for one in each.ways])
        for each in fusions
        if all(one in by_way for one in each.ways)
    ]


def generate_function(function: TransferFunction, constants: Mapping[str, Constant]) -> Program:
    """Return the program of one function alone, from inputs of its own. Raises GenerationError."""
    provides = tuple(Provision(name, name) for name in function.inputs)
    sources = Service("inputs", "/inputs", "", "", None, provides).sources
    inputs = tuple(Derivation(source.property, source, None) for source in sources)
    derivation = Derivation(function.output, None, function, inputs)
    return generate([(derivation, "/output/data")], constants)


def inputs_of(derivations: Sequence[Derivation]) -> Tuple[Source, ...]:
    """Return the sources that the program of some derivations reads, in its order."""
    sources: Dict[Tuple[str, str], Source] = {}
    for node in in_order(derivations):
        if node.source is not None:
            sources.setdefault(_place(node.source), node.source)
    return tuple(sources.values())


def _place(source: Source) -> Tuple[str, str]:
    """Return what identifies an input: nodes that share a topic give different values."""
    return source.path, source.node


def in_order(roots: Sequence[Derivation]) -> List[Derivation]:
    """Return every derivation once, inputs before what is made of them, left to right."""
    done: Dict[Derivation, None] = {}
    stack = list(reversed(roots))
    while stack:
        lacking = [each for each in stack[-1].inputs if each not in done]
        if lacking:
            stack.extend(reversed(lacking))
        else:
            done.setdefault(stack.pop())
    return list(done)


def _definition(
    name: str, function: TransferFunction, constants: Mapping[str, Constant]
) -> List[str]:
    if function.law is None:
        raise GenerationError(
            f"the relation {function.relation} for {function.output} cannot be executed: "
            f"{function.text}"
        )
    parameters = {prop: f"i{i}" for i, prop in enumerate(function.inputs, 1)}
    lines = [f"def {name}({','.join(parameters.values())}): # {_title(function)}"]

    def known(part: Union[Law, Condition]) -> Dict[str, str]:
        return {n: parameters.get(n) or _number(constants[n].value) for n in part.names}

    if function.constraint is not None:
        lines.append(f"  require({function.constraint.code(known(function.constraint))})")
    return lines + ["  " + line for line in function.law.body(known(function.law))]


def _number(value: float) -> str:
    return repr(value) if value >= 0 else f"({value!r})"
