"""The robot at a glance as lines of text, of the document that the view shows."""
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from shsa_core.model.kinds import Word
from shsa_core.text import shown
from shsa_view.judgement import Condition

Document = Mapping[str, Any]

LEAST_WIDTH, LEAST_HEIGHT = 20, 5
"""In less room lines are cut."""
WIDEST = 28
"""Characters of a name, and of a publisher."""
GAP = "  "
STATE_WIDTH = max(map(len, Condition))
RATE_WIDTH = 9
SHARE_OF_INCIDENTS = 3
"""Open incidents take at most one line in so many."""
WORST_FIRST = (
    *(Condition.NOT_HEALED, Condition.KEPT, Condition.HEALING, Condition.SUBSTITUTED),
    *(Condition.RETURNING, Condition.FAILED, Condition.UNKNOWN, Condition.STARTING),
    Condition.WELL,
)
_PLAIN, _GOOD, _FAIR, _BAD, _HEAD, _DIM = "", "32", "33", "1;31", "1", "2"
_COLOURS: Dict[str, str] = {
    **dict.fromkeys(("well", "alive"), _GOOD),
    **dict.fromkeys(("substituted", "returning", "healing", "failed"), _FAIR),
    **dict.fromkeys(("not_healed", "kept", "lost"), _BAD),
}


class Sort(Word):
    """The order of the services."""

    STATE = "state"
    NAME = "name"
    RATE = "rate"

    @property
    def next(self) -> "Sort":
        """The one after it."""
        all_ = list(Sort)
        return all_[(all_.index(self) + 1) % len(all_)]


class Look(NamedTuple):
    """A view of the table: its room in characters, the order, the first row, and colours.

    `height` None: all rows, for a file.
    """

    width: int
    height: Optional[int] = None
    sort: Sort = Sort.STATE
    first: int = 0
    colour: bool = False


class Line(NamedTuple):
    """A line, and what of it is coloured: the text, and its colour by ANSI."""

    parts: Sequence[Tuple[str, str]]

    def text(self, width: int, colour: bool) -> str:
        """Return the line, cut to `width`."""
        told = ""
        for part, code in self.parts:
            part = shown(part)[:width]
            width -= len(part)
            told += f"\x1b[{code}m{part}\x1b[0m" if colour and code and part else part
        return told


class Glance(NamedTuple):
    """Lines of text, and the first service in them: the one that was wanted, or one before it."""

    lines: List[str]
    first: int


def lines(document: Document, look: Look) -> List[str]:
    """Return the lines of the document."""
    return glance(document, look).lines


def glance(document: Document, look: Look, notice: str = "") -> Glance:
    """Return the lines of the document; `notice`: about the connection, if not empty."""
    head, incidents, first = [*_head(document, notice)], [*_incidents(document)], 0
    width = max(look.width, 1)
    rows = ordered(document["services"], look.sort)
    table = _Table(rows, document["services"], max(width, LEAST_WIDTH))
    body = [table.line(name) for name in rows]
    foot: List[Line] = []
    if look.height is not None:
        most = max(1, look.height // SHARE_OF_INCIDENTS)
        if len(incidents) > most:
            incidents = [*incidents[: most - 1], _line(f"... and {len(incidents) - most + 1} more")]
        room = max(1, look.height - len(head) - len(incidents) - 2)
        first = max(0, min(look.first, len(body) - room))  # the last page is full
        foot = [_foot(look.sort, first, room, len(body))]
        body = body[first : first + room]
    told = [*head, table.head(), *body, *incidents, *foot]
    if look.height is not None:
        told = told[: max(look.height, 1)]
    return Glance([line.text(width, look.colour) for line in told], first)


def ordered(services: Mapping[str, Document], sort: Sort) -> List[str]:
    """Return the names of the services in an order."""
    keys: Dict[Sort, Callable[[str], Any]] = {
        Sort.NAME: lambda name: name,
        Sort.STATE: lambda name: (_badness(services[name]), not services[name]["needed"], name),
        Sort.RATE: lambda name: (-(services[name]["rate"] or 0.0), name),
    }
    return sorted(services, key=keys[sort])


def value(prop: Document) -> str:
    """Return the last value of a property, its expected error, and its unit."""
    if prop["value"] is None:
        return "-"
    error = prop["error_p95"] if prop["error_p95"] is not None else prop["error_rms"]
    around = "" if error is None else f" ± {error:.2g}"
    unit = f" {prop['unit']}" if prop["unit"] else ""
    return f"{prop['value']:.4g}{around}{unit}"


class _Table:
    """The services: a row each, with as many columns as there is room for."""

    def __init__(self, names: Sequence[str], services: Mapping[str, Document], width: int) -> None:
        self._services = services
        publishers = (_publisher(services[name]) for name in names)
        self._name = _widest(["service", *names])
        self._publisher = _widest(["publisher", *publishers])
        left = width - self._name - STATE_WIDTH - len(GAP)
        self._has_rate = left >= RATE_WIDTH + len(GAP)
        left -= RATE_WIDTH + len(GAP) if self._has_rate else 0
        self._has_publisher = left >= self._publisher + RATE_WIDTH + 2 * len(GAP)
        left -= self._publisher + len(GAP) if self._has_publisher else 0
        self._value = max(left - len(GAP), 0)

    def head(self) -> Line:
        """Return the names of the columns."""
        cells = self._cells("service", "state", "rate", "publisher", "value ± error in 95 %")
        return Line([("".join(cells).rstrip(), _HEAD)])

    def line(self, name: str) -> Line:
        """Return the row of a service."""
        row = self._services[name]
        rate = "" if row["rate"] is None else f"{row['rate']:.1f} Hz"
        cells = self._cells(name, row["state"], rate, _publisher(row), _values(row))
        colours = [_PLAIN, _COLOURS.get(row["state"], _DIM), *[_PLAIN] * (len(cells) - 2)]
        return Line([*zip([*cells[:-1], cells[-1].rstrip()], colours)])

    def _cells(self, name: str, state: str, rate: str, publisher: str, told: str) -> List[str]:
        cells = [_fit(name, self._name) + GAP, _fit(state, STATE_WIDTH)]
        if self._has_rate:
            cells.append(f"{GAP}{rate:>{RATE_WIDTH}}")
        if self._has_publisher:
            cells.append(GAP + _fit(publisher, self._publisher))
        if self._value:
            cells.append(GAP + _fit(told, self._value))
        return cells


def _head(document: Document, notice: str) -> List[Line]:
    robot, healing = document["robot"], document["healing"]
    word = robot["state"].replace("_", " ").upper()
    told = [Line([(word, _COLOURS.get(robot["state"], _DIM)), (f"{GAP}{robot['text']}", _PLAIN)])]
    wrong = [who for who in ("monitor", "reconfigurator", "master") if healing[who] == "lost"]
    if wrong or healing["text"]:
        text = healing["text"] or ", ".join(f"{who} lost" for who in wrong)
        told.append(Line([(text, _BAD if wrong else _PLAIN)]))
    if document.get("trust", {}).get("state") in ("unchecked", "refused"):
        told.append(Line([(document["trust"]["text"], _FAIR)]))
    lost = [f"{name} lost" for name, row in document["hosts"].items() if row["state"] == "lost"]
    if lost:
        told.append(Line([(f"computers: {', '.join(lost)}", _BAD)]))
    if notice:
        told.append(Line([(notice, _BAD)]))
    return [*told, _line("")]


def _incidents(document: Document) -> List[Line]:
    found = [each for each in document["incidents"] if each["state"] != "ended"]
    still_open = {row["incident_key"] for row in document["services"].values()}
    found = [each for each in found if each["key"] in still_open]
    if not found:
        return []
    return [
        _line(""),
        Line([("open incidents", _HEAD)]),
        *(_line(_incident(each, document["now"])) for each in found),
    ]


def _incident(incident: Document, now: float) -> str:
    since = now - incident["moments"]["detected"]
    stands_in = incident["substitute"]
    done = f"{stands_in} replaces it" if stands_in else incident["state"].replace("_", " ")
    if incident["missing"]:
        done += f", missing {', '.join(incident['missing'])}"
    what = f"{incident['id']}. {incident['service']}, {incident['kind']} for {_time(since)}"
    return f"{what}: {done}"


def _foot(sort: Sort, first: int, room: int, rows: int) -> Line:
    part = f", {first + 1} to {min(first + room, rows)} of {rows}" if rows > room else ""
    return Line([(f"q quit, s sorted by {sort}{part}", _DIM)])


def _values(row: Document) -> str:
    properties = row["properties"]
    if len(properties) == 1:
        return value(*properties.values())
    return ", ".join(f"{name} {value(prop)}" for name, prop in properties.items())


def _publisher(row: Document) -> str:
    return row["publisher"] or "-"


def _badness(row: Document) -> int:
    states = [str(each) for each in WORST_FIRST]
    return states.index(row["state"]) if row["state"] in states else 0


def _widest(texts: Sequence[str]) -> int:
    return min(max(len(text) for text in texts), WIDEST)


def _fit(text: str, width: int) -> str:
    """Shorten a text to `width` characters in its middle: names differ at their ends."""
    text = shown(text)
    return text.ljust(width) if len(text) <= width else text[: max(width - 1, 0)] + "~"


def _time(seconds: float) -> str:
    seconds = max(seconds, 0.0)
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.0f} h"


def _line(text: str) -> Line:
    return Line([(text, _PLAIN)])
