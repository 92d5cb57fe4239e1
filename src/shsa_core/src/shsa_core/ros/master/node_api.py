"""Calls to a node's own XML-RPC interface, and to the master's.

Anybody may answer: a call has one deadline from its begin to its end, an answer has a
largest size, and is looked at before it is used.
"""
import http.client
import re
import socket
import time
import xmlrpc.client
from typing import Any, Dict, FrozenSet, NamedTuple, Optional, Tuple, Union

import rosgraph
import rosgraph.network
import rospy

from shsa_core.errors import ShsaError
from shsa_core.ros import settings

LARGEST_ANSWER_B = 1024 * 1024
"""A node of 1,000 topics needs a fifth of it."""
MASTER = settings.PATIENCE_S, 64 * 1024 * 1024
"""Bounds of a call to the master in s and bytes: it tells of every node."""

FAILURES = (rosgraph.MasterException, OSError, xmlrpc.client.Error, http.client.HTTPException)
"""Exceptions of a call without an answer, with a refusal, or with one that makes no sense."""

URI = re.compile(r"http://(\[[0-9A-Fa-f:.]{2,45}\]|[A-Za-z0-9._-]{1,253}):([0-9]{1,5})/?")


class BadAnswer(xmlrpc.client.Error):
    """A node answers what is no answer."""


class Address(NamedTuple):
    """Host and port of a node."""

    host: str
    port: int


def address(uri: object) -> Address:
    """Return host and port of a node's URI. Raises BadAnswer if it is none."""
    found = URI.fullmatch(uri) if isinstance(uri, str) else None
    if found is None or not 0 < int(found.group(2)) < 65536:
        raise BadAnswer(f"{uri!r:.100} is no address of a node")
    return Address(found.group(1).strip("[]"), int(found.group(2)))


def family(host: str) -> int:
    """Return the address family of a numeric host."""
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def resolved(uri: object) -> Address:
    """Return the one numeric address of a node's URI, of the family of ROS_IPV6 if it has one.

    Who is called there and whose the kernel says it is must be the same. Raises BadAnswer, OSError.
    """
    host, port = address(uri)
    try:
        found = socket.getaddrinfo(host, port, proto=socket.IPPROTO_TCP)
    except UnicodeError as error:
        raise BadAnswer(f"{uri!r:.100} is no address of a node") from error
    usual = socket.AF_INET6 if rosgraph.network.use_ipv6() else socket.AF_INET
    best = next((each for each in found if each[0] == usual), found[0])
    return Address(str(best[4][0]), port)


def located(uri: object) -> str:
    """Return a URI with its numeric address. Raises BadAnswer, OSError."""
    return uri_at(resolved(uri))


def uri_at(at: Address) -> str:
    """Return the URI of a numeric address."""
    return f"http://[{at.host}]:{at.port}/" if ":" in at.host else f"http://{at.host}:{at.port}/"


class Answer(NamedTuple):
    """The answer of a node, when it was asked and had answered: ns on the monotonic clock."""

    value: Any
    asked: int
    answered: int


def ask(uri: str, method: str, *arguments: Any) -> Any:
    """Return the value that the node at `uri` answers. Raises one of FAILURES."""
    return ask_timed(uri, method, *arguments).value


def ask_timed(uri: str, method: str, *arguments: Any) -> Answer:
    """Return the same, with its times: the connection was made before. Raises one of FAILURES."""
    transport = _Transport(settings.CALL_S, LARGEST_ANSWER_B)
    api = xmlrpc.client.ServerProxy(located(uri), transport=transport)
    answer = getattr(api, method)(rospy.get_name(), *arguments)
    answered = time.monotonic_ns()
    is_row = isinstance(answer, (list, tuple)) and len(answer) > 0
    if method == "getBusStats" and is_row and not _is_int(answer[0]):
        answer = 1, "", answer  # roscpp leaves out the status
    if not is_row or len(answer) != 3 or not _is_int(answer[0]):
        raise BadAnswer(f"{uri} answers {method} with {answer!r:.100}")
    if answer[0] != 1:
        raise BadAnswer(f"{uri} refuses {method}: {answer[1]!r:.100}")
    return Answer(answer[2], transport.connected, answered)


def pid(uri: str) -> int:
    """Return the process that a node says it is. Raises one of FAILURES."""
    number = ask(uri, "getPid")
    if not _is_int(number) or not 0 < number < 2**22 + 1:
        raise BadAnswer(f"{uri} says that its process is {number!r:.100}")
    return int(number)


def topics(uri: str, method: str = "getPublications") -> Dict[str, str]:
    """Return the topics that a node says it publishes, and their types. Raises one of FAILURES."""
    rows = ask(uri, method)
    if not isinstance(rows, list) or not all(_is_row(row) for row in rows):
        raise BadAnswer(f"{uri} answers {method} with {rows!r:.100}")
    return dict(rows)


def node_api(
    uri: str, timeout: float = settings.CALL_S, largest: int = LARGEST_ANSWER_B
) -> xmlrpc.client.ServerProxy:
    """Return the interface of the node at `uri`; its calls raise one of FAILURES.

    `timeout`: of a call in s; `largest`: bytes of an answer.
    """
    return xmlrpc.client.ServerProxy(uri, transport=_Transport(timeout, largest))


def master_uri() -> str:
    """Return the URI of our master. Raises ShsaError if it is none."""
    uri = str(rosgraph.get_master_uri())
    try:
        address(uri)
    except BadAnswer:
        wanted = "http://HOST:PORT, as http://localhost:11311"
        raise ShsaError(f"ROS_MASTER_URI is {uri!r:.100}: it must be {wanted}") from None
    return uri


def master_api(caller_id: str = "") -> rosgraph.Master:
    """Return the interface of `master_uri`, as us or another; its calls raise one of FAILURES."""
    master = rosgraph.Master(caller_id or rospy.get_name(), master_uri())
    master.handle = node_api(master.master_uri, *MASTER)
    return master


def uri_of(node: str) -> str:
    """Return where the master says that a node is; empty: it knows no such node.

    Raises one of FAILURES if it does not answer.
    """
    try:
        return str(master_api().lookupNode(node))
    except rosgraph.MasterException:
        return ""


class _Transport(xmlrpc.client.Transport):
    """One call, one connection, one deadline."""

    accept_gzip_encoding = False

    def __init__(self, timeout: float, largest: int) -> None:
        super().__init__()
        self._timeout, self._largest = timeout, largest
        self._end = 0.0
        self.connected = 0
        """The time at which the connection was made."""

    def request(self, host, handler, request_body, verbose=False):  # type: ignore[no-untyped-def]
        self._end = time.monotonic() + self._timeout
        try:
            return self.single_request(host, handler, request_body, verbose)
        except FAILURES:
            raise
        except Exception as error:  # what a parser raises at nonsense is of no certain kind
            raise BadAnswer(f"{host!r:.100} answers nonsense: {error!r:.100}") from error
        finally:
            self.close()

    def make_connection(self, host):  # type: ignore[no-untyped-def]
        connection = http.client.HTTPConnection(host)
        left = max(1e-3, self._end - time.monotonic())
        made = socket.create_connection((connection.host, connection.port), left)
        connection.sock = _Socket(made, self._end, self._largest)
        self.connected = time.monotonic_ns()
        return connection

    def parse_response(self, response):  # type: ignore[no-untyped-def]
        text = response.read()
        # What a parser would make larger than it came is not parsed.
        if response.getheader("Content-Encoding") or b"<!" in text:
            raise BadAnswer("the answer is no plain XML-RPC")
        parser, target = self.getparser()
        parser.feed(text)
        parser.close()
        return target.close()


class _Socket(socket.socket):
    """Gives up at `end`, whatever comes bit by bit, and after `largest` bytes."""

    def __init__(self, connected: socket.socket, end: float, largest: int) -> None:
        super().__init__(fileno=connected.detach())
        self._end, self._left = end, largest
        self.settimeout(max(1e-3, end - time.monotonic()))

    def recv_into(self, buffer, *arguments):  # type: ignore[no-untyped-def]
        left = self._end - time.monotonic()
        if left <= 0.0:
            raise socket.timeout("timed out")
        self.settimeout(left)
        count = super().recv_into(buffer, *arguments)
        self._left -= count
        if self._left < 0:
            raise BadAnswer("the answer is too large")
        return count


def _is_int(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_row(row: object) -> bool:
    return isinstance(row, list) and [type(each) for each in row] == [str, str]


COUNTER = 2**32
"""roscpp counts in 32 bits."""


class Sent(NamedTuple):
    """Counters of a node on a topic: bytes published, messages by connection; at a time in ns."""

    data: int
    messages: Dict[int, int]
    at: int


def sent(answer: Answer, topic: str) -> Optional[Sent]:
    """Read what a node has sent on a topic from its answer to getBusStats; None: it is nonsense.

    A topic is [name, bytes, connections] in rospy, without the bytes in roscpp; a connection is
    [number, bytes, messages, connected], or [number, bytes, bytes of data, messages, 0].
    """
    try:
        rows = [row for row in answer.value[0] if row[0] == topic]
        messages = {int(each[0]): int(each[-2]) for row in rows for each in row[-1]}
        return Sent(sum(int(row[1]) for row in rows if len(row) == 3), messages, answer.answered)
    except (LookupError, TypeError, ValueError):
        return None


def rate(uri: str, topic: str, seconds: float) -> Optional[float]:
    """Return the messages/s that a node sends to its best-served subscriber; 0: no answer.

    None: it cannot be told, as nobody is connected to it. Takes `seconds` and two calls.
    """
    first = _look(uri, topic)
    rospy.rostime.wallsleep(seconds)
    second = _look(uri, topic)
    if isinstance(first, OSError) and isinstance(second, OSError):
        return 0.0  # it hangs: it was asked where it runs
    if isinstance(first, Sent) and isinstance(second, Sent):
        return between(first, second)
    return None


def between(first: Sent, second: Sent) -> Optional[float]:
    """Return the messages/s from one look to the next; None: nobody is connected to get any."""
    numbers = first.messages.keys() & second.messages.keys()
    most = max(((second.messages[n] - first.messages[n]) % COUNTER for n in numbers), default=None)
    if most is None or (most == 0 and second.data != first.data):
        return None  # in the latter case all connections are held up, and it publishes
    return 1e9 * most / (second.at - first.at)


def _look(uri: str, topic: str) -> Union[Sent, OSError, None]:
    try:
        return sent(ask_timed(uri, "getBusStats"), topic)
    except OSError as error:
        return error
    except FAILURES:
        return None


class Originals:
    """Looks at the nodes that a substitute stands in for; for one thread."""

    def __init__(self) -> None:
        self._seen: Dict[str, Tuple[str, Dict[Any, str]]] = {}  # their addresses, and their ends

    def served_consumers(self, topic: str, original: str) -> Optional[FrozenSet[str]]:
        """Return the consumers to which the node `original` has published on a topic already.

        None if it does not answer, or not as nodes do. Messages of a node wait while it answers who
        its consumers are: it is asked that only where it is not known.
        """
        seen = self._seen.pop(original, None)  # else the master is asked again
        try:
            uri, ends = seen or (master_api().lookupNode(original), {})
            stats = sent(ask_timed(uri, "getBusStats"), topic)
            if stats is None:
                return None
            served = {number for number, count in stats.messages.items() if count}
            if not served <= ends.keys():
                ends = connected(topic, uri)
            consumers = frozenset(ends[each] for each in served if each in ends)
        except (*FAILURES, LookupError, TypeError):
            return None
        self._seen[original] = uri, ends
        return consumers


def connected(topic: str, uri: str) -> Dict[Any, str]:
    """Return who is at the other end of a publisher's connections, by number.

    Raises one of FAILURES, LookupError or TypeError.
    """
    info = ask(uri, "getBusInfo")
    return {row[0]: str(row[1]) for row in info if row[2] == "o" and row[4] == topic}
