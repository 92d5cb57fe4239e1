"""A substitute's three strings at work: inputs, compiled code, output advertised."""
from typing import Optional, Sequence

import genpy
import rospy

from shsa_core.codegen.program import compile_program
from shsa_core.errors import ShsaError
from shsa_core.model.som import Service
from shsa_core.ros.graph import clock
from shsa_core.ros.graph.fields import Field, unknown_message
from shsa_core.ros.graph.handover import Handover, publish_to_others
from shsa_core.ros.graph.inputs import Input
from shsa_core.ros.graph.messages import message_class
from shsa_core.ros.graph.outputs import Outputs

GAP_PERIODS = 10.0  # after so many periods without a value, derivatives and the like start anew
SHORTEST_GAP = 1.0  # s


class Computation:
    """Computes the fields `services` of one topic from `inputs`, by generated code, and publishes through `outputs`.

    Raises ShsaError if the code is not valid, or if the services are not numbers of one topic.
    """

    def __init__(
        self, inputs: Sequence[Input], code: str, services: Sequence[Service], outputs: Outputs
    ) -> None:
        self._inputs = inputs
        topics = sorted({service.topic for service in services})
        if len(topics) != 1:
            raise ShsaError(f"OUTPUT must name fields of one topic, not of {', '.join(topics)}")
        self.period = min(service.period for service in services)
        gap = max(SHORTEST_GAP, GAP_PERIODS * self.period)
        self._program = compile_program(code, len(inputs), len(services), max_gap=gap)
        self._class = message_class(services[0].type)
        self._fields = [Field(self._class, service.field) for service in services]
        self._publisher = outputs.take(services[0])
        self._handover = Handover(topics[0], self.period)

    @property
    def complete(self) -> bool:
        """Whether every input has come at least once."""
        return all(each.value is not None for each in self._inputs)

    def message(self) -> Optional[genpy.Message]:
        """The output now; None while an input is stale or the code yields nothing: no value is invented."""
        now = clock.now()
        values = [each.value for each in self._inputs if each.fresh(now)]
        if len(values) < len(self._inputs):
            return None
        result = self._program.step([v for v in values if v is not None], now)
        if result is None:
            return None
        message = unknown_message(self._class)
        for field, value in zip(self._fields, result):
            field.set(message, value)
        if message._has_header:
            message.header.stamp = rospy.Time.now()
        return message

    def publish(self, message: genpy.Message) -> None:
        """Send it to the consumers of the topic that the original does not serve."""
        publish_to_others(self._publisher, message, self._handover.served)

    def stand_in_for(self, original: str) -> None:
        """Yield each consumer to the node `original` as soon as that serves it; `""`: to none."""
        self._handover.follow(original)

    def close(self) -> None:
        """Compute no more."""
        self._handover.close()
