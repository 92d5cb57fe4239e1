"""Tells healing of a failure for a monitor of your own, so that it is believed."""
from typing import Optional

import rospy
from shsa_msgs import msg

from shsa_core.errors import ShsaError
from shsa_core.model.kinds import Kind
from shsa_core.ros.trust.signing import SignedPublisher, Signing
from shsa_core.ros.wire import names


class FailurePublisher:
    """Publishes signed failures on shsa/failures, in the namespace of this node.

    `secret`: the file with healing's secret, or a copy on another computer; empty: the default one.
    Raises ShsaError if it cannot be read, as by another user than healing's.
    """

    def __init__(self, secret: str = "") -> None:
        self._publisher = SignedPublisher(Signing(secret), names.FAILURES, msg.Failure)

    def publish(
        self,
        topic: str,
        publisher: str,
        kind: str = "other",
        detail: str = "",
        last_good: Optional[rospy.Time] = None,
    ) -> None:
        """Tell that the node `publisher` fails on `topic`.

        `kind`: one of those in shsa_msgs/Failure. `detail`: what was seen and what is allowed.
        `last_good`: when its last good message came. Raises ShsaError if the kind is none.
        """
        if kind not in tuple(Kind):
            raise ShsaError(f"the kind of failure {kind!r} is none of {', '.join(Kind)}")
        failure = msg.Failure(topic=topic, publisher=publisher, kind=str(kind), detail=detail)
        failure.header.stamp = rospy.Time.now()
        failure.last_good = last_good or rospy.Time()
        self._publisher.publish(failure)

    def get_num_connections(self) -> int:
        """Return how many reconfigurators, and others, listen."""
        return int(self._publisher.publisher.get_num_connections())
