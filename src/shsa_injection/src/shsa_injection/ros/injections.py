"""The faults that are made on a running system: a class each place, each is taken back."""
import json
import select
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, suppress
from types import TracebackType
from typing import Any, Callable, Dict, Optional, Type, TypeVar

import psutil

from shsa_core.errors import ShsaError
from shsa_core.model.service import Service
from shsa_injection import channel
from shsa_injection.errors import Refused
from shsa_injection.ros import healers, master, targets
from shsa_injection.ros.guard import Guard
from shsa_injection.ros.targets import Start, Target
from shsa_injection.vocabulary import FAULTS, Place

ANSWER_TIMEOUT_S = 5.0
CHILD_TIMEOUT_S = 15.0

Self = TypeVar("Self", bound="Injection")


class Injection:
    """A fault that is being made; as a context it is taken back at its end, whatever happens.

    `node`, `pid`: of what fails; `detail`: what was drawn; `began`, `ended`: moments of the
    monotonic clock; `told`: what was done to messages or processes, once it has ended.
    """

    def __init__(self, fault: str, topic: str, seconds: Optional[float], seed: int) -> None:
        self.fault, self.topic, self.seconds, self.seed = fault, topic, seconds, seed
        self.node = ""
        self.pid = 0
        self.detail = ""
        self.told: Dict[str, Any] = {}
        self.began = self.ended = 0.0
        self._undo = ExitStack()

    def __enter__(self: Self) -> Self:
        self.began = time.monotonic()
        try:
            self._begin()
        except psutil.Error as error:
            self._undo.close()
            raise Refused(f"{self.node or 'the master'}: {error}") from error
        except BaseException:
            self._undo.close()
            raise
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self._undo.close()
        self.ended = self.ended or time.monotonic()

    def wait(self) -> None:
        """Wait for its deadline; without one, for ever."""
        while self.seconds is None or time.monotonic() < self.began + self.seconds:
            left = 3600.0 if self.seconds is None else self.began + self.seconds - time.monotonic()
            time.sleep(max(0.0, left))

    def _begin(self) -> None:
        raise NotImplementedError

    def _harm(self, target: Target) -> None:
        """Make a node's process end, or stop it."""
        if self.fault == "hang":
            self._hang(target)
            return
        start = targets.start_of(target.process)
        if self.seconds is not None:
            former = {"pid": target.pid, "created": target.created}
            guard = Guard({**start_order(start), **former, "seconds": self.seconds})
            self._undo.callback(lambda: self.told.update(guard.end()))
        self.began = time.monotonic()  # to start a guard takes as long as a short fault
        if self.fault == "crash":
            target.process.kill()
        else:
            targets.ask_to_leave(target)

    def _hang(self, target: Target) -> None:
        order = {"action": "continue", "pid": target.pid, "created": target.created}
        guard = Guard({**order, "seconds": self.seconds})
        self._undo.callback(lambda: self.told.update(guard.end()))
        self._undo.callback(targets.send_signal, target.process, signal.SIGCONT)
        if not targets.send_signal(target.process, signal.SIGSTOP):
            raise Refused(f"{self.node} has ended")


def start_again(start: Start) -> int:
    """Start a node as it was started before, through a guard that ends it with its launch; its pid.

    Raises Refused if it cannot be started.
    """
    told = Guard({**start_order(start), "seconds": 0.0}).end()
    if not told.get("done"):
        why = "it runs already" if told.get("runs") else "what started it has ended"
        raise Refused(f"{' '.join(start.words)} is not started again: {why}")
    return int(told["pid"])


def start_order(start: Start) -> Dict[str, Any]:
    """Return the order by which a guard starts a program as it was started."""
    return {
        "action": "start",
        "words": start.words,
        "folder": start.folder,
        "environment": start.environment,
        "starter": start.starter[0] if start.starter else None,
        "starter_created": start.starter[1] if start.starter else 0.0,
    }


class _ServiceInjection(Injection):
    """A fault of one service."""

    def __init__(self, service: Service, fault: str, seconds: Optional[float], seed: int) -> None:
        super().__init__(fault, service.topic, seconds, seed)
        self.service = service
        self.node = service.node

    def _begin(self) -> None:
        target = targets.find(self.service)
        self.pid = target.pid
        self._make(target)

    def _make(self, target: Target) -> None:
        raise NotImplementedError


class _ProcessInjection(_ServiceInjection):
    """off, crash and hang of a service's node."""

    def _make(self, target: Target) -> None:
        self._harm(target)


class HealerInjection(Injection):
    """crash and hang of one of the nodes of healing."""

    def __init__(self, name: str, fault: str, seconds: float) -> None:
        super().__init__(fault, "", seconds, 0)
        self.node = name

    def _begin(self) -> None:
        process = healers.only(self.node).process
        self.pid = process.pid
        self._harm(Target(self.node, "", process))


class _MessageInjection(_ServiceInjection):
    """Faults inside the node: of its messages, or of the serial line that it reads."""

    def _make(self, target: Target) -> None:
        connection = self._undo.enter_context(connection_to(target))
        channel.send(connection, request_for(self.service, self.fault, self.seconds, self.seed))
        self.detail = checked(channel.receive(connection))["detail"]
        self._undo.callback(self._end, connection)

    def _end(self, connection: Any) -> None:
        with suppress(OSError):  # the fault may have ended by itself, and the node as well
            connection.shutdown(socket.SHUT_WR)
        with suppress(OSError):
            self.told.update(channel.receive(connection))
        self.ended = time.monotonic()


class _StrangerInjection(_ServiceInjection):
    """A stranger on the topic: one that publishes, or a subscriber that is stopped."""

    def _make(self, target: Target) -> None:
        hangs = self.fault == "hung_subscriber"
        words = ["subscribe", self.topic, "3.0"] if hangs else ["publish"]
        child = subprocess.Popen(
            [sys.executable, "-m", "shsa_injection.ros.stranger", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        process = psutil.Process(child.pid)
        self._undo.callback(_end_child, child)
        assert child.stdin is not None and child.stdout is not None
        if not hangs:
            request = request_for(self.service, "garbage", None, self.seed)
            claimed = self.node if self.fault == "spoof_name" else ""
            request.update({"type": self.service.type, "name": claimed})
            child.stdin.write(json.dumps(request).encode() + b"\n")
            child.stdin.flush()
        came = select.select([child.stdout], [], [], CHILD_TIMEOUT_S)[0]
        told = json.loads(child.stdout.readline() or b"{}") if came else {}
        if "node" not in told:
            raise Refused(f"the stranger on {self.topic} did not come up")
        self.told.update(stranger=told["node"])
        if hangs:
            # It ends with its standard input, once somebody lets it.
            order = {"action": "continue", "pid": child.pid, "created": process.create_time()}
            self._undo.enter_context(Guard({**order, "seconds": self.seconds}))
            targets.send_signal(process, signal.SIGSTOP)
        self.began = time.monotonic()


class MasterInjection(Injection):
    """The master, killed and started again."""

    def _begin(self) -> None:
        process = master.find()
        self.node, self.pid = "master", process.pid
        order = {**start_order(master.start_of(process)), "seconds": self.seconds}
        guard = Guard(order)
        self._undo.callback(lambda: self.told.update(guard.end()))
        process.kill()
        if not targets.has_ended(process):
            raise Refused("the master does not end")


INJECTIONS: Dict[Place, Callable[..., Injection]] = {
    Place.PROCESS: _ProcessInjection,
    Place.MESSAGES: _MessageInjection,
    Place.LINE: _MessageInjection,
    Place.GRAPH: _StrangerInjection,
}


def request_for(
    service: Service, fault: str, seconds: Optional[float], seed: int
) -> Dict[str, Any]:
    """Return the request to an injectable node."""
    request: Dict[str, Any] = {"fault": fault, "seconds": seconds, "seed": seed}
    if FAULTS[fault].place is not Place.LINE:
        request["topic"] = service.topic
        request["period"] = service.period
        request["values"] = [[p.field, p.range and list(p.range)] for p in service.provides]
    return request


def connection_to(target: Target) -> Any:
    """Return a connection to what makes a node fail from inside. Raises Refused if it has none."""
    node = target.node
    try:
        environment = target.process.environ()
        return channel.connect(target.pid, environment, ANSWER_TIMEOUT_S)
    except (ShsaError, psutil.Error, OSError) as error:
        raise Refused(
            f"the messages of {node} cannot fail: it was not started by `rosrun shsa_injection "
            f"injectable`, or is no rospy node; only its process can ({error})"
        ) from error


def checked(answer: Dict[str, Any]) -> Dict[str, Any]:
    if "detail" not in answer:
        raise Refused(answer.get("refused", "the node did not answer"))
    return answer


def _end_child(child: "subprocess.Popen[bytes]") -> None:
    """Let a stranger leave in order, so that it does not stay registered."""
    assert child.stdin is not None and child.stdout is not None
    child.stdin.close()
    child.stdout.close()
    try:
        child.wait(targets.SHUTDOWN_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
