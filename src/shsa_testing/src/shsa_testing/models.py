"""Small and random ontologies for the tests of the search, and the rule for best, spelled out."""
from fractions import Fraction
from itertools import product
from pathlib import Path
from random import Random
from typing import Dict, Iterable, Iterator, List, Optional, Sequence, Tuple

from hypothesis import strategies as st

from shsa_core.files.ontology_file import read_ontology
from shsa_core.language.expression import parse_law
from shsa_core.model.ontology import Ontology, Property, TransferFunction
from shsa_core.model.service import Provision, Service, Source
from shsa_core.model.som import Som
from shsa_core.search.derivation import Derivation

# 0.81 is 0.9 squared, and 0.45 is 0.9 times 0.5: products that tie only if they are compared
# exactly.
QUALITIES = [1.0, 0.9, 0.81, 0.5, 0.25, 0.45]


def source(
    name: str, topic: str = "", node: str = "", quality: float = 1.0, needed: bool = False
) -> Source:
    """A source of the property `name`; its topic and node are called after it unless given."""
    topic = topic or "/" + name
    node = node or "/node_of" + topic.replace("/", "_")
    return service(topic, node, [Provision(name, name, quality=quality)], needed).sources[0]


def service(
    topic: str, node: str, provides: Iterable[Provision], needed: Optional[bool] = False
) -> Service:
    """A service called after its topic and node."""
    name = topic[1:] + "_of_" + node[1:]
    return Service(name, topic, "std_msgs/Float64", node, 0.1, tuple(provides), needed=needed)


def som_of(sources: Iterable[Source]) -> Som:
    """The SOM in which sources of one topic and node are one service.

    It is needed if one of them is.
    """
    needed: Dict[Tuple[str, str], Optional[bool]] = {}
    provides: Dict[Tuple[str, str], Dict[str, Provision]] = {}
    for each in sources:
        key = each.topic, each.node
        needed[key] = needed.get(key, False) or each.service.needed
        provides.setdefault(key, {}).setdefault(each.property, each.provision)
    return Som(service(*key, provides[key].values(), needed[key]) for key in provides)


def law(relation: str, output: str, *inputs: str, quality: float = 1.0) -> TransferFunction:
    """A function that adds up its inputs."""
    text = " + ".join(inputs) or "1"
    return TransferFunction(relation, output, inputs, parse_law(text), quality, text=text)


def ontology(*functions: TransferFunction) -> Ontology:
    """The ontology of these functions."""
    names = {name for f in functions for name in (f.output, *f.inputs)}
    return Ontology({name: Property(name) for name in sorted(names)}, {}, functions)


def ontology_in(folder: Path, text: str) -> Ontology:
    """The ontology of a file of this text, made in a folder."""
    path = folder / "ontology.yaml"
    path.write_text(text)
    return read_ontology(str(path))


Rank = Tuple[Fraction, int, int, List[Tuple[str, str]]]


def rank(derivation: Derivation) -> Rank:
    """Rate a derivation exactly: minus quality, relations, inputs, names.

    The least is the best.
    """
    if derivation.source is not None:
        own = derivation.source
        return -Fraction(str(own.quality)), 0, 1, [(own.path, own.node)]
    assert derivation.function is not None
    quality = -Fraction(str(derivation.function.quality))
    relations, inputs, names = 1, 0, [(derivation.function.relation, "")]
    for part in map(rank, derivation.inputs):
        quality *= -part[0]
        relations += part[1]
        inputs += part[2]
        names += part[3]
    return quality, relations, inputs, names


def every_derivation(
    model: Ontology, sources: Sequence[Source], name: str, path: Tuple[str, ...] = ()
) -> Iterator[Derivation]:
    """Every derivation in which no property is derived from itself, by plain recursion."""
    for own in dict.fromkeys(sources):
        if own.property == name:
            yield Derivation(name, own, None)
    yields = [function for function in model.functions if function.output == name]
    for function in sorted(yields, key=lambda each: each.relation):
        if not {*path, name}.intersection(function.inputs):
            choices = [
                list(every_derivation(model, sources, i, (*path, name))) for i in function.inputs
            ]
            for inputs in product(*choices):
                yield Derivation(name, None, function, inputs)


def usable(sources: Sequence[Source], excluded: Sequence[str]) -> List[Source]:
    """The sources on none of the excluded nodes and topics."""
    return [s for s in sources if s.node not in excluded and s.topic not in excluded]


def random_model(seed: int) -> Tuple[Ontology, List[Source], List[str]]:
    """A random ontology, sources, and which nodes and topics are excluded.

    Its laws have one or more directions, some are constant, many lie on cycles. Properties have
    none, one or more sources, some of them on the same topic or node.
    """
    random = Random(seed)
    names = "abcdef"[: random.randint(2, 6)]
    functions = []
    for number in range(random.randint(1, 7)):
        used = random.sample(names, random.randint(1, min(3, len(names))))
        quality = random.choice(QUALITIES)
        for output in used[: random.randint(1, len(used))]:
            inputs = [name for name in used if name != output]
            functions.append(law("r%d" % number, output, *inputs, quality=quality))
    sources = []
    for name in names:
        for _ in range(random.choice([0, 1, 1, 2, 3])):
            topic, node = random.choice(["/s", "/t", ""]), random.choice(["/m", "/n", ""])
            sources.append(source(name, topic, node, random.choice(QUALITIES)))
    excluded = random.sample(["/m", "/s", "/a", "/b"], random.randint(0, 2))
    return ontology(*functions), sources, excluded


models = st.builds(random_model, st.integers(0, 2**64))
