"""Compares what the services' own nodes say with what others tell of it, and learns from both."""
from math import isfinite
from typing import Dict, NamedTuple, Optional

from shsa_core.codegen.prediction import predictor
from shsa_core.model.ontology import Ontology
from shsa_core.model.samples import ValueSample
from shsa_core.model.service import Deadlines, Service
from shsa_core.model.som import Som
from shsa_core.monitoring.calibrations import Calibrations
from shsa_core.monitoring.derivations import Derivations
from shsa_core.monitoring.events import Message
from shsa_core.monitoring.evidence import Finding
from shsa_core.monitoring.publishers import Publisher
from shsa_core.monitoring.witness import Witnesses


class Compared(NamedTuple):
    """A message of a service's own node. `looked`: all its derivations were evaluated with it."""

    service: Service
    values: Dict[str, float]
    looked: bool
    finding: Optional[Finding]


class Comparisons:
    """The derivations of a SOM's services, and who asks for them. Times in s."""

    def __init__(self, ontology: Ontology, deadlines: Deadlines) -> None:
        self._ontology, self._som = ontology, Som()
        self._derivations = Derivations(deadlines)
        self.calibrations = Calibrations(ontology, self._derivations)
        self._witnesses = Witnesses(ontology, self._derivations)

    def watch(self, som: Som) -> None:
        """Compare the services of `som` from now on; one that has changed begins anew."""
        before, self._som = self._som.services, som
        changed = [name for name in before if before[name] != som.services.get(name)]
        knows = predictor(self._ontology, som.sources)
        self._derivations.watch(som, changed)
        self.calibrations.watch(som, knows, changed)
        self._witnesses.watch(som, knows)

    def compare(self, publisher: Publisher, message: Message, good: bool) -> Optional[Compared]:
        """Compare a message, `good` by itself, with what others tell; None: nobody asks for it."""
        service, evidence = publisher.service, publisher.evidence
        if service is None or evidence is None or message.values is None:
            return None
        if not self._derivations.concerns(service):
            return None
        if service.node != publisher.name:
            self._derivations.unmeasured(service, message.time)
            return None
        named, time = zip(evidence.properties, message.values), message.time
        values = {name: v for name, v in named if v is not None and isfinite(v)}
        looked = self._derivations.heard(service, values, time, good and publisher.is_healthy)
        if looked:
            self._witnesses.look(service, publisher.suspicions, values, time)
        findings = (each.finding for each in publisher.suspicions.values())
        return Compared(service, values, looked, next(filter(None, findings), None))

    def confirms(self, publisher: Publisher, outside: ValueSample, time: float) -> bool:
        """Tell if a derived value is about as far out of a range, on the same side."""
        service = publisher.service
        if service is None or outside.range is None or service.node != publisher.name:
            return False
        low, high = outside.range
        beyond = max(low - outside.value, outside.value - high)
        for derived in self._derivations.derived(service, outside.name, time):
            same_side = derived < low if outside.value < low else derived > high
            if same_side and 0.5 * beyond <= max(low - derived, derived - high) <= 2.0 * beyond:
                return True
        return False

    def learn(self, publisher: Publisher, compared: Compared, time: float, good: bool) -> None:
        """Learn from a message that was compared; who fails, or is in doubt, teaches nothing."""
        doubtful = any(each.doubtful for each in publisher.suspicions.values())
        sound = good and publisher.is_healthy and not doubtful
        service, values, looked, _ = compared
        self._derivations.judged(service, values, time, sound, looked)
