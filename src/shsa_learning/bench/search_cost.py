"""Cost of the search: by size and shape of the ontology, in memory, and for the report.

    python3 search_cost.py [--largest N] [--results DIR]

Prints the growth exponents and the goals; leaves search_cost.csv, .txt, .png and
search_cost_goals.csv. Times are processor time, the least of several runs, without garbage
collection, as timeit takes them.
"""
import argparse
import csv
import dataclasses
import gc
import math
import multiprocessing
import random
import re
from itertools import islice
from pathlib import Path
from time import perf_counter, process_time
from typing import Callable, Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from matplotlib import pyplot
from report import Goals

from shsa_core.codegen.plans import plan_service
from shsa_core.language.expression import parse_law
from shsa_core.model.ontology import Ontology, Property, TransferFunction
from shsa_core.model.service import Provision, Service, Source
from shsa_core.model.som import Som
from shsa_core.planning.plan_table import PlanTable
from shsa_core.search.depth_first import first_found
from shsa_core.search.derivation import Rated, SourceTable
from shsa_learning.check import check_model
from shsa_learning.report.resilience import analyse
from shsa_learning.substitutes import find_substitute, substitutes

QUALITIES = [1.0, 0.99, 0.95, 0.9, 0.8]
TARGET = "p0"
ROUNDS = 4
ANY = parse_law("1")  # the functions' contents do not matter to the search


def find_first(
    ontology: Ontology, sources: Sequence[Source], target: str, excluded: Sequence[str] = ()
) -> Optional[Rated]:
    network = ontology.network
    left = [each for each in sources if each.service.topic not in excluded]
    return first_found(SourceTable(network, left), network.number(target))


Say = Callable[[str], None]
Model = Tuple[List[TransferFunction], List[Source]]


def law(relation: int, output: int, inputs: Iterable[int], quality: float) -> TransferFunction:
    names = tuple(f"p{number}" for number in dict.fromkeys(inputs))
    return TransferFunction(f"r{relation}", f"p{output}", names, ANY, quality)


def service(number: int, node: str = "", needed: bool = False, quality: float = 1.0) -> Service:
    provides = (Provision(f"p{number}", "data", quality=quality),)
    node = node or f"/n{number}"
    topic, message = f"/p{number}", "std_msgs/Float64"
    return Service(f"s{number}", topic, message, node, 0.1, provides, needed=needed)


def source(number: int, quality: float = 1.0) -> Source:
    return service(number, quality=quality).sources[0]


def chain(size: int) -> Model:
    """Return each property from the next; the last one is measured."""
    return [law(i, i, [i + 1], 0.9) for i in range(size)], [source(size)]


def tree(size: int) -> Model:
    """Return a balanced binary tree; the leaves are measured."""
    functions = [law(i, i, [2 * i + 1, 2 * i + 2], 0.9) for i in range(size)]
    return functions, [source(i) for i in range(size, 2 * size + 1)]


def dense(size: int) -> Model:
    """Four relations for each property, each from two random later ones."""
    draw = random.Random(size)
    last = size // 4
    functions = [
        law(4 * i + k, i, [i + 1, draw.randint(i + 1, last)], draw.choice(QUALITIES))
        for i in range(last)
        for k in range(4)
    ]
    return functions, [source(last)]


def cycles(size: int) -> Model:
    """Laws in all three directions between neighbours, so that all depends on all.

    Every fifth is measured.
    """
    draw = random.Random(size)
    functions = []
    for i in range(size // 3):
        used = [i, i + 1, i + draw.randint(2, 5)]
        quality = draw.choice(QUALITIES)
        functions += [law(i, output, [x for x in used if x != output], quality) for output in used]
    return functions, [source(i, quality=0.99) for i in range(5, size // 3, 5)]


def knot(size: int) -> Model:
    """Four relations for each property from random ones: one cycle, the worst case."""
    draw = random.Random(size)
    count = size // 4
    functions = [
        law(4 * i + k, i, draw.sample(range(count), 2 if k else 1), draw.choice(QUALITIES))
        for i in range(count)
        for k in range(4)
    ]
    measured = draw.sample(range(1, count), count // 10)
    return functions, [source(i, quality=0.9) for i in measured]


SHAPES: Dict[str, Callable[[int], Model]] = {
    "chain": chain,
    "tree": tree,
    "dense": dense,
    "cycles": cycles,
    "knot": knot,
}


class Row(NamedTuple):
    """One measurement; times in s, memory in bytes."""

    shape: str
    relations: int
    best: float
    first_found: float
    make: float
    memory: int


def least(action: Callable[[], object], seconds: float = 1.0) -> float:
    """Return the least time of one run, in s; repeated for some time."""
    times: List[float] = []
    gc.collect()
    gc.disable()
    while len(times) < 2 or (sum(times) < seconds and len(times) < 100):
        start = process_time()
        action()
        times.append(process_time() - start)
    gc.enable()
    return min(times)


def peak(shape: str, size: int) -> int:
    """By how many bytes the memory of a new process grows during a search, at most."""
    spawn = multiprocessing.get_context("spawn")
    with spawn.Pool(1) as pool:
        return pool.apply(grown, (shape, size))


def grown(shape: str, size: int) -> int:
    functions, services = SHAPES[shape](size)
    ontology = Ontology({}, {}, functions)
    before = memory("VmRSS")
    found = find_substitute(ontology, services, TARGET, [f"/{TARGET}"])
    assert found.proven_best
    return memory("VmHWM") - before


def memory(key: str) -> int:
    with open("/proc/self/status", encoding="ascii") as stream:
        found = re.search(key + r":\s+(\d+) kB", stream.read())
    assert found is not None
    return 1024 * int(found.group(1))


def growth(rows: Iterable[Row], value: Callable[[Row], float]) -> float:
    """Return the exponent b of the fit value = a * relations ** b."""
    points = np.log([(row.relations, value(row)) for row in rows])
    return float(np.polyfit(points[:, 0], points[:, 1], 1)[0])


def by_size(sizes: Sequence[int], say: Say, goals: Goals) -> List[Row]:
    """Return every shape in every size."""
    finders: Sequence[Callable[..., object]] = (find_substitute, find_first)
    rows = []
    for name, shape in SHAPES.items():
        models = []
        for size in sizes:
            functions, services = shape(size)
            start = process_time()
            models.append((Ontology({}, {}, functions), services, process_time() - start))
        # Round and round, so that a slow moment of the computer does not meet one size alone.
        best: Dict[int, float] = {}
        first: Dict[int, float] = {}
        for turn in range(ROUNDS * len(models)):
            i = turn % len(models)
            ontology, services, _ = models[i]
            times = [
                least(lambda: find(ontology, services, TARGET, [f"/{TARGET}"]), 0.3)
                for find in finders
            ]
            best[i] = min(best.get(i, times[0]), times[0])
            first[i] = min(first.get(i, times[1]), times[1])
        for i, (ontology, _, make) in enumerate(models):
            size = len(ontology.functions)
            row = Row(name, size, best[i], first[i], make, peak(name, sizes[i]))
            rows.append(row)
            say(
                f"{name:7} {row.relations:8} relations: best {1e3 * row.best:10.2f} ms "
                f"({1e6 * row.best / row.relations:.2f} us each), first found "
                f"{1e3 * row.first_found:10.2f} ms, {row.memory / row.relations:6.0f} bytes each"
            )
    for name in SHAPES:
        own = [row for row in rows if row.shape == name]
        exponent = growth(own, lambda row: row.best)
        other = growth(own, lambda row: row.first_found)
        say(f"growth exponent, {name:7}: best {exponent:.3f}, first found {other:.3f}")
        if name != "knot":
            goals.at_most(f"growth exponent of the search, {name}", "", 1.1, exponent, "")
    return rows


def small_tree(say: Say, goals: Goals) -> None:
    """A balanced binary tree of a few nodes."""
    for nodes in (127, 511):
        functions, services = tree(nodes // 2)
        ontology = Ontology({}, {}, functions)
        best = least(lambda: find_substitute(ontology, services, TARGET))
        first = least(lambda: find_first(ontology, services, TARGET))
        say(f"tree of {nodes} nodes: best {1e3 * best:.3f} ms, first found {1e3 * first:.3f} ms")
    goals.at_most("best substitute in a tree of 511 nodes", "", 1.0, 1e3 * best, "ms")


def small_in_huge(size: int, say: Say, goals: Goals) -> None:
    """A chain of 20 relations, alone and beside a huge ontology."""
    small = [law(i, i, [i + 1], 0.9) for i in range(20)]
    others, _ = cycles(size)
    moved = [
        TransferFunction("s" + f.relation, "q" + f.output, tuple("q" + i for i in f.inputs), ANY)
        for f in others
    ]
    alone, beside = (
        least(lambda: find_substitute(ontology, [source(20)], TARGET))
        for ontology in (Ontology({}, {}, small), Ontology({}, {}, moved + small))
    )
    say(
        f"a chain of 20 relations: alone {1e6 * alone:.0f} us, beside {len(moved)} others "
        f"{1e6 * beside:.0f} us"
    )
    goals.at_most(
        "a small robot in a huge ontology, times the small one", "", 1.5, beside / alone, ""
    )


def ready_plans(size: int, say: Say, goals: Goals) -> None:
    """Chains side by side, short enough for code to be generated.

    A hundred of their ends are needed.
    """
    length = 50
    count = size // length
    functions: List[TransferFunction] = []
    for number in range(count):
        for i in range(length):
            output = number * (length + 1) + i
            one = law(len(functions), output, [output + 1], 0.99)
            text = parse_law(f"2*{one.inputs[0]}")
            functions.append(dataclasses.replace(one, law=text))
    tops = [service(c * (length + 1), needed=c < 100) for c in range(count)]
    bottoms = [service(c * (length + 1) + length, quality=0.99) for c in range(count)]
    som = Som(tops + bottoms)
    model = Ontology({}, {}, functions)
    search = lambda lost, without: plan_service(model, lost, table.sources, without)
    table: PlanTable = PlanTable(model, som.needed(), search)
    start = perf_counter()
    table.change((), list(som))
    updated = perf_counter() - start
    steps = 0
    while table.step() is not None:
        steps += 1
    made = (perf_counter() - start - updated) / steps
    lookup = least(lambda: table.plan("s0"), 0.1)
    start = perf_counter()
    table.change([som.services[f"s{length}"]], ())
    changed = perf_counter() - start
    assert table.plan("s0") is None
    say(
        f"{len(functions)} relations, {len(som)} services, {steps} plans: lookup "
        f"{1e6 * lookup:.1f} us; made in {1e3 * made:.1f} ms each; all services come in "
        f"{1e3 * updated:.1f} ms, one goes in {1e3 * changed:.1f} ms"
    )
    goals.at_most(f"lookup of a plan at {len(functions)} relations", "", 0.1, 1e3 * lookup, "ms")


def executable(functions: Iterable[TransferFunction]) -> List[TransferFunction]:
    """Return the same with laws that use their inputs: code can be generated for them."""
    return [dataclasses.replace(f, law=parse_law(" + ".join(f.inputs))) for f in functions]


def resilience(say: Say, goals: Goals) -> None:
    """A robot of 1,000 nodes and 10,000 functions, a fifth of its topics needed, or all."""
    functions = executable(cycles(10000)[0])
    ontology = Ontology({}, {}, functions)
    for share in (0.2, 1.0):
        draw = random.Random(1)
        som = Som(
            service(3 * i, f"/n{i}", draw.random() < share, draw.choice([1.0, 0.99, 0.98]))
            for i in range(1000)
        )
        start = perf_counter()
        found = analyse(ontology, som)
        passed = perf_counter() - start
        say(
            f"resilience of 1000 nodes, {len(functions)} functions, {len(found.services)} needed "
            f"services: {passed:.1f} s, {len(found.cuts)} cuts"
        )
        goals.at_most(
            f"resilience report, {len(found.services)} needed services", "", 60.0, passed, "s"
        )


def unhealable(sizes: Sequence[int], say: Say, goals: Goals) -> None:
    """Robots of which only 232 services are measured, so few that none of them can be healed."""
    needed = 232
    times: List[Tuple[float, float]] = []
    for size in sizes:
        functions, _ = cycles(size)
        functions = executable(functions)
        names = dict.fromkeys(name for f in functions for name in (f.output, *f.inputs))
        ontology = Ontology({name: Property(name) for name in names}, {}, functions)
        step = len(names) // needed
        som = Som(service(i * step, needed=True) for i in range(needed))
        start = process_time()
        findings = check_model(ontology, som)
        checked = process_time() - start
        report = analyse(ontology, som)
        times.append((checked, process_time() - start - checked))
        lost = sum("is needed" in finding.what for finding in findings)
        missing = sum(len(each.missing) for each in report.services)
        say(
            f"{len(functions)} relations, {lost} of {needed} needed services cannot be healed, "
            f"{missing} names of what is missing: check {times[-1][0]:.1f} s, "
            f"report {times[-1][1]:.1f} s"
        )
    for place, what in enumerate(("check", "report")):
        ratio = times[-1][place] / times[0][place] * sizes[0] / sizes[-1]
        goals.at_most(
            f"{what}, nothing heals: time at {sizes[-1]} relations by that at {sizes[0]}, "
            "each by its size",
            "",
            2.0,
            ratio,
            "",
        )


def second_best(sizes: Sequence[int], say: Say, goals: Goals) -> None:
    """The second-best substitute in a ring, where the best one uses every relation.

    Quadratic, as docs/reference/ontology.md says.
    """
    times = []
    for size in sizes:
        ring = [law(i, i, [(i + 1) % size], 0.9999) for i in range(size)]
        ontology = Ontology({}, {}, ring)
        sources = [source(size - 1), source(size // 2, quality=0.01)]
        start = process_time()
        found = list(islice(substitutes(ontology, sources, TARGET), 2))
        times.append(process_time() - start)
        assert len(found) == 2
        say(f"ring of {size} relations: the two best substitutes after {times[-1]:.2f} s")
    exponent = math.log(times[-1] / times[0]) / math.log(sizes[-1] / sizes[0])
    goals.at_most("growth exponent of the second-best in a ring", "", 2.2, exponent, "")


def by_deadline(size: int, say: Say, goals: Goals) -> None:
    """Return the quality that is found by each deadline, and when the answer comes."""
    for name in ("cycles", "knot"):
        functions, services = SHAPES[name](size)
        ontology = Ontology({}, {}, functions)
        times: List[float] = []
        qualities: List[float] = []
        for steps in (10, 100, 1000, 3000, 10000, None):
            question = ontology, services, TARGET, [f"/{TARGET}"], steps
            found = find_substitute(*question)
            times.append(least(lambda: find_substitute(*question), 0.3))
            qualities.append(found.quality)
            whole = "all" if steps is None else f"{steps} steps"
            say(
                f"{name:7} {size} relations, {whole:>11}: quality {found.quality:.3g} after "
                f"{1e3 * times[-1]:.1f} ms, proven best: {found.proven_best}"
            )
        assert qualities == sorted(qualities)
        share = times[0] / times[-1]
        goals.at_most(f"first answer, by the time of the best, {name}", "", 0.5, share, "")


def plot(rows: List[Row], path: Path) -> None:
    figure, (time, space) = pyplot.subplots(1, 2, figsize=(11, 4.5))
    for name in SHAPES:
        own = [row for row in rows if row.shape == name]
        sizes = [row.relations for row in own]
        exponent = growth(own, lambda row: row.best)
        time.loglog(
            sizes, [row.best for row in own], "o-", label=f"{name}: exponent {exponent:.2f}"
        )
        space.loglog(sizes, [row.memory for row in own], "o-", label=name)
    sizes = sorted({row.relations for row in rows})
    time.loglog(sizes, [3e-6 * size for size in sizes], "k:", label="3 us for each relation")
    time.set_ylabel("best substitute found after (s)")
    space.set_ylabel("memory taken (bytes)")
    for axes in (time, space):
        axes.set_xlabel("relations in reach")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(str(path), dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(description="Measures what the search costs.")
    parser.add_argument("--largest", type=int, default=10**6, help="most relations (1000000)")
    parser.add_argument(
        "--results", type=Path, default=Path("results/bench"), help="where to write"
    )
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    lines: List[str] = []
    goals = Goals()

    def say(line: str) -> None:
        print(line, flush=True)
        lines.append(line)

    rows = by_size([10**k for k in range(3, 7) if 10**k <= options.largest], say, goals)
    small_tree(say, goals)
    small_in_huge(options.largest, say, goals)
    ready_plans(min(options.largest, 10**5), say, goals)
    resilience(say, goals)
    unhealable([5000, 20000], say, goals)
    second_best([1000, 4000], say, goals)
    by_deadline(min(options.largest, 10**5), say, goals)
    with open(options.results / "search_cost.csv", "w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(Row._fields)
        writer.writerows(rows)
    (options.results / "search_cost.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    plot(rows, options.results / "search_cost.png")
    goals.show(options.results / "search_cost_goals.csv")


if __name__ == "__main__":
    main()
