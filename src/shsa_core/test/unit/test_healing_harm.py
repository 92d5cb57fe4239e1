"""First, do no harm: any robot, any fault, and never less good data than without healing."""
from random import Random
from typing import List, Tuple

from plant import GOOD, SILENT, WRONG, HealedPlant, any_robot

from shsa_testing.thorough import many

ROBOTS = many(1000)
FAULTS = 4


def any_fault(healed: HealedPlant, random: Random) -> Tuple[str, List[str]]:
    """An event, and its node or services."""
    plant = healed.plant
    service = random.choice(list(healed.som))
    mine = [each.name for each in healed.som if each.node == service.node]
    if not plant.up[service.node]:
        return "start", [service.node]
    quiet = [name for name in mine if plant.says[name] == SILENT]
    if quiet and random.random() < 0.5:
        return GOOD, quiet  # it wakes
    what = random.choice(("die", SILENT, SILENT, WRONG, WRONG, "request"))
    if what in ("die", "request"):
        return what, [service.node if what == "die" else service.name]
    well = [name for name in mine if plant.says[name] == GOOD]
    whole = random.random() < 0.4  # a hung node, or one that babbles on every topic
    return what, well if whole else well[:1]


def story(seed: int) -> Tuple[List[str], int]:
    """Topics that healing has spoiled on one robot, and lost services that it gave again."""
    random = Random(seed)
    ontology, som = any_robot(random)
    healed = HealedPlant(ontology, som, random, pool=1)
    found: List[str] = []
    gained = 0
    for _ in range(FAULTS):
        what, names = any_fault(healed, random)
        without, killed = healed.plant.frozen(), len(healed.killed)
        if what == "request":
            healed.request(som.services[names[0]])
        else:
            without.fault(what, names)
            healed.episode(what, names)
        healed.core.validate()
        healed.asked.clear()
        told = f"robot {seed}: after {what} of {', '.join(names)}"
        gained += len(healed.plant.good() - without.good())
        lost = without.good() - healed.plant.good()
        if lost:
            found.append(f"{told}: lost {sorted(lost)}")
        for node, innocent in healed.killed[killed:]:
            if innocent:
                found.append(f"{told}: {node} was healthy, and was killed")
            if node in healed.protected:
                found.append(f"{told}: {node} is protected, and was killed")
            if all(str(each.policy) == "advise" for each in som if each.node == node):
                found.append(f"{told}: {node} was killed against its policy")
        for service in som:
            voices = [n for n, row in healed.plant.rows.items() if row.service == service.name]
            speaks = [n for n in voices if healed.plant.substitute(n) != "muted"]
            if healed.plant.original(service) in (GOOD, WRONG) and speaks:
                found.append(f"{told}: two speak on {service.topic}")
    return found, gained


def test_no_robot_has_less_good_data_than_without_healing() -> None:
    """After each fault: compared with the same robot if healing did nothing about it."""
    stories = [story(seed) for seed in range(ROBOTS)]
    spoiled = [found for found, _ in stories if found]
    assert not spoiled, f"{len(spoiled)} of {ROBOTS} robots, such as: {spoiled[0]}"
    assert sum(gained for _, gained in stories) > ROBOTS / 4, "whoever does nothing spoils nothing"
