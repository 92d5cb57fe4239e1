"""Documents as the server tells them: of a small robot, of a large one, and of a hostile one."""
from typing import Any, Dict, Iterable, List, Optional

Document = Dict[str, Any]

BEGAN = 1_700_000_000.0
MOMENTS = (
    *("last_good", "detected", "killed", "found", "spawned"),
    *("first_message", "returned", "ended"),
)
EVIDENCE = "battery_current is 71, allowed -5 to 60 (3 of 3 messages)"
HOSTILE = "<script>window.hurt = 1</script><img src=x onerror='window.hurt = 1'>"


def prop(value: Optional[float], unit: str, p95: Optional[float] = None) -> Document:
    """Return a property of a service, with its last value."""
    rms = None if p95 is None else p95 / 2
    told = {"field": "data", "unit": unit, "symbol": "", "value": value, "range": None}
    return {**told, "error_rms": rms, "error_p95": p95}


def service(topic: str, properties: Document, **others: Any) -> Document:
    """Return the row of a service that is well."""
    node = others.get("publisher") or topic
    return {
        **{"topic": topic, "type": "std_msgs/Float64", "needed": True, "standby": "warm"},
        **{"period": 0.02, "host": "", "node": node, "state": "well", "detail": ""},
        **{
            "publisher": node,
            "substitute": None,
            "rate": 50.0,
            "why": "",
            "bridged": 0,
            "weakened": "",
            "incident": None,
        },
        **{"fate": "is kept: it takes /cmd_vel", "remedies": []},
        **{"properties": properties, "derivation": [], "strip": "u" * 3 + "w" * 57},
        **others,
    }


def document(services: Document, **others: Any) -> Document:
    """Return a whole state."""
    return {
        **{"version": 1, "now": BEGAN + 60, "namespace": "/", "actions": False},
        "robot": {"state": "well", "text": f"All well. {len(services)} services are watched."},
        "healing": {"monitor": "alive", "reconfigurator": "alive", "master": "alive", "text": ""},
        **{"services": services, "substitutes": {}, "hosts": {}, "incidents": []},
        **others,
    }


def incident(number: float = 1, name: str = "amperemeter", **others: Any) -> Document:
    """Return an incident that a substitute stands in for, with six of its moments."""
    after = (0.0, 0.021, 0.034, 0.029, 0.031, 0.043)
    began = BEGAN + 60 * number
    told: List[Optional[float]] = [*(began + each for each in after), None, None]
    return {
        **{"key": f"{began}-{number}", "id": number, "service": name, "topic": f"/{name}"},
        **{"faulty_node": f"/{name}", "kind": "node_gone", "state": "healed"},
        **{"evidence": EVIDENCE, "detail": "the connection to the node was lost"},
        "moments": dict(zip(MOMENTS, told)),
        "substitute": f"/substitute_{name}_1",
        **{"inputs": ["/battery_voltage/data"], "relations": ["power"], "quality": 0.87},
        **{"error_rms": [0.2], "error_p95": [0.4], "missing": [], "lost": []},
        "decision": "killed: nothing else on its topic",
        **others,
    }


def robot() -> Document:
    """Two services that are well."""
    return document(
        {
            "amperemeter": service("/battery_current", {"battery_current": prop(3.214, "A", 0.06)}),
            "voltmeter": service("/battery_voltage", {"battery_voltage": prop(12.31, "V", 0.02)}),
        }
    )


def large(count: int) -> Document:
    """So many services, all well."""
    return document(
        {
            f"sensor_{number:03d}": service(
                f"/sensor_{number:03d}", {f"value_{number:03d}": prop(float(number), "V", 0.1)}
            )
            for number in range(count)
        }
    )


def hostile() -> Document:
    """Markup wherever a text can be."""
    bad = service(
        f"/{HOSTILE}",
        {HOSTILE: prop(1.0, HOSTILE, 0.1)},
        **{"state": "substituted", "detail": HOSTILE, "publisher": f"/{HOSTILE}", "why": HOSTILE},
        weakened=HOSTILE,
        remedies=[{"text": HOSTILE, "command": HOSTILE}],
        **{"substitute": HOSTILE, "incident": 1, "host": HOSTILE, "strip": HOSTILE},
    )
    texts: Any = {
        key: HOSTILE
        for key in ("faulty_node", "kind", "evidence", "detail", "substitute", "decision")
    }
    lists: Any = {key: [HOSTILE] for key in ("inputs", "relations", "missing", "lost")}
    return document(
        {HOSTILE: bad},
        robot={"state": HOSTILE, "text": HOSTILE},
        healing={"monitor": HOSTILE, "reconfigurator": "lost", "master": "alive", "text": HOSTILE},
        hosts={HOSTILE: {"state": "lost", "text": HOSTILE}},
        incidents=[incident(1, HOSTILE, key=HOSTILE, **texts, **lists)],
        namespace=HOSTILE,
    )


SVG = (
    "<svg xmlns='http://www.w3.org/2000/svg' xmlns:xlink='http://www.w3.org/1999/xlink'"
    " width='300pt' height='120pt' viewBox='0 0 300 120'>"
    "<g id='graph0' class='graph'>"
    "<g id='service-amperemeter' class='node'><title>s</title>"
    "<polygon points='10,10 90,10 90,40 10,40'/><text x='15' y='30'>amperemeter</text></g>"
    "<g id='property-battery_current' class='node'><ellipse cx='50' cy='90' rx='40' ry='15'/>"
    "<text x='15' y='94'>battery_current</text></g>"
    "<g id='relation-power-battery_current' class='node'><ellipse cx='150' cy='90' rx='30'"
    " ry='15'/><text x='130' y='94'>power</text></g>"
    "<g id='edge-1' class='edge'><path d='M50 40L50 75'/></g>"
    "<g id='edge-2' class='edge'><path d='M120 90L90 90'/></g>"
    "{more}</g></svg>"
)
HOSTILE_SVG = (
    "<script>window.hurt = 1</script><a xlink:href='javascript:window.hurt = 1'>"
    "<g id='property-x' class='node' onclick='window.hurt = 1' style='fill:red'>"
    "<text>x</text></g></a><foreignObject><body xmlns='http://www.w3.org/1999/xhtml'>"
    "<img src='x' onerror='window.hurt = 1'/></body></foreignObject>"
    "<image href='http://127.0.0.1:1/x.png'/>"
)


def drawing_of(names: Iterable[str]) -> Document:
    """Return the answer of /api/graph for services that provide a property each."""
    shapes, edges = "", []
    for place, name in enumerate(names):
        ends = f"service-{name}", f"property-of-{name}"
        shapes += f"<g id='edge-{place}' class='edge'><path d='M0 {place}H9'/></g>"
        shapes += "".join(f"<g id='{each}' class='node'><text>{each}</text></g>" for each in ends)
        edges.append({"id": f"edge-{place}", "from": ends[0], "to": ends[1]})
    svg = f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 9 {len(edges)}'>{shapes}</svg>"
    return {"svg": svg, "error": "", "edges": edges}


def drawing(more: str = "") -> Document:
    """Return the answer of /api/graph."""
    edges = [
        {"id": "edge-1", "from": "service-amperemeter", "to": "property-battery_current"},
        {
            "id": "edge-2",
            "from": "relation-power-battery_current",
            "to": "property-battery_current",
        },
    ]
    return {"svg": SVG.replace("{more}", more), "error": "", "edges": edges}
