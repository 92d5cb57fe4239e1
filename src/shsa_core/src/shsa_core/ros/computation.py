"""A substitute's three strings at work: inputs, compiled code, output advertised."""
import threading
from typing import Callable, Optional, Sequence

import genpy
import rospy

from shsa_core.errors import ShsaError
from shsa_core.program import compile_program
from shsa_core.ros import clock
from shsa_core.ros.announce import announce
from shsa_core.ros.fields import Field, unknown_message
from shsa_core.ros.handover import Handover, publish_to_others
from shsa_core.ros.inputs import Input
from shsa_core.ros.messages import message_class
from shsa_core.som import Service

GAP_PERIODS = 10.0  # after so many periods without a value, derivatives and the like start anew
SHORTEST_GAP = 1.0  # s


class _Joining(rospy.SubscribeListener):
    def __init__(self, joined: Callable[[], None]) -> None:
        super().__init__()
        self._joined = joined

    def peer_subscribe(self, *_: object) -> None:
        self._joined()


class Computation:
    """Computes the fields `outputs` of one topic from `inputs`, by generated code.

    `joined` is called, from rospy's threads, when a consumer has connected.

    Raises ShsaError if the code is not valid, or if the outputs are not numbers of one topic.
    """

    def __init__(
        self,
        inputs: Sequence[Input],
        code: str,
        outputs: Sequence[Service],
        joined: Callable[[], None],
    ) -> None:
        self._inputs = inputs
        topics = sorted({service.topic for service in outputs})
        if len(topics) != 1:
            raise ShsaError(f"OUTPUT must name fields of one topic, not of {', '.join(topics)}")
        topic, kind = topics[0], outputs[0].type
        self.period = min(service.period for service in outputs)
        gap = max(SHORTEST_GAP, GAP_PERIODS * self.period)
        self._program = compile_program(code, len(inputs), len(outputs), max_gap=gap)
        self._class = message_class(kind)
        self._outputs = [Field(self._class, service.field) for service in outputs]
        self._publisher = rospy.Publisher(
            topic, self._class, _Joining(joined), queue_size=10, tcp_nodelay=True
        )
        threading.Thread(target=announce, args=(self._publisher,), daemon=True).start()
        self._handover = Handover(topic, self.period)

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
        for field, value in zip(self._outputs, result):
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
        """End the publication."""
        self._handover.close()
        self._publisher.unregister()
