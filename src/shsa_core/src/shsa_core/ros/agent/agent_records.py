"""What the next agent of a computer must know: the nodes that this one has started again."""
from typing import Callable, Iterator, List

import rospy

from shsa_core.errors import ShsaError
from shsa_core.healing.events import NodeRestarted
from shsa_core.healing.records import RestartedNode
from shsa_core.journal.record_file import RecordFile, read_records
from shsa_core.ros.processes.kernel import same_process
from shsa_core.ros.processes.restarting import Restarts
from shsa_core.ros.succession import CODEC, owner, record_path


class AgentRecords:
    """Keeps them in a file of this master, namespace and agent."""

    def __init__(self, name: str, warn: Callable[[str], None] = rospy.logwarn) -> None:
        self._path, self._owner = record_path(f"agent_{name}"), owner()
        self._file = RecordFile(self._path, CODEC, self._owner, warn)

    def take_up(self, restarts: Restarts) -> Iterator[RestartedNode]:
        """Have those that still run be ours; a process number that was used again is another's."""
        for record in self._former():
            found = same_process(record.process)
            if found is not None:
                restarts.take_up(record.node, found, record.starter)
                self._file.write([record])
                yield record

    def started(self, event: NodeRestarted) -> None:
        """A node was started again."""
        told = event.node, event.with_us, event.process, event.starter
        self._file.write([RestartedNode(*told)])

    def stopped(self, node: str) -> None:
        """A node was stopped."""
        self._file.write((), [f"restarted {node}"])

    def _former(self) -> List[RestartedNode]:
        try:
            former = read_records(self._path, CODEC)
        except ShsaError as error:
            rospy.logerr("Refused: %s. What was started again is not taken up.", error)
            return []
        if former.owner.get("boot") != self._owner["boot"]:
            return []
        return [each for each in former.records if isinstance(each, RestartedNode)]
