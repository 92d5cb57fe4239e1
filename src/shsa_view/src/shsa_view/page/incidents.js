// The timeline: each incident with its eight moments, the newest first.
import { byId, draw, facts, make, setAttribute, setShape, setText, shape } from "./page.js";
import { MOMENTS, clock, day, exactClock, known, list, plain, short, span, word } from "./words.js";

const SHOWN = 20;
const FIRST_DECADE = -3;
const DECADES = 6;
const AROUND_S = 10;

export class Incidents {
  /** `asked(key)` is called when somebody asks for the values around an incident. */
  constructor(asked) {
    this.asked = asked;
    this.list = byId("timeline");
    this.items = new Map();
    this.limit = SHOWN;
    this.opened = null;
    this.older = make("button", { type: "button", id: "older" });
    this.older.addEventListener("click", () => {
      this.limit = Infinity;
      this.show(this.whole);
    });
  }

  show(whole) {
    this.whole = whole;
    const incidents = whole.incidents.slice(0, this.limit);
    const keys = new Set(incidents.map((each) => each.key));
    for (const [key, item] of this.items) {
      if (keys.has(key)) continue;
      item.element.remove();
      this.items.delete(key);
    }
    incidents.forEach((incident, index) => this.place(incident, index, whole.now));
    if (incidents.length) this.open(this.items.get(incidents[0].key));
    this.count(whole.incidents.length);
  }

  place(incident, index, now) {
    let item = this.items.get(incident.key);
    if (!item) {
      item = new Item(incident.key, this.asked);
      this.items.set(incident.key, item);
    }
    item.show(incident, now);
    if (this.list.children[index] !== item.element) {
      this.list.insertBefore(item.element, this.list.children[index] || null);
    }
  }

  /** The newest is open; the one before closes, unless somebody opened it. */
  open(newest) {
    if (newest === this.opened) return;
    if (this.opened && !this.opened.touched) this.opened.details.open = false;
    this.opened = newest;
    if (!newest.touched) newest.details.open = true;
  }

  count(all) {
    byId("no-incidents").hidden = all > 0;
    setText(byId("incidents-count"), all ? String(all) : "");
    setText(this.older, `Show ${all - this.limit} older`);
    if (all > this.limit) this.list.after(this.older);
    else this.older.remove();
  }
}

class Item {
  constructor(key, asked) {
    this.touched = false;
    this.values = make("button", { type: "button", class: "values-around" }, "Values around it");
    this.values.addEventListener("click", () => asked(key));
    this.shape = shape("unknown");
    this.when = make("time", { class: "when" });
    this.what = make("b");
    this.outcome = make("span", { class: "outcome" });
    this.rest = make("div", { class: "rest" });
    const lines = make("span", {}, this.when, " ", this.what, this.outcome);
    const summary = make("summary", {}, this.shape, lines);
    summary.addEventListener("click", () => {
      this.touched = true;
    });
    this.details = make("details", {}, summary, this.rest);
    this.details.addEventListener("toggle", () => this.fill());
    this.element = make("li", { "data-incident": key }, this.details);
  }

  show(incident, now) {
    const signature = JSON.stringify(incident);
    if (signature === this.signature) return;
    this.signature = signature;
    this.incident = incident;
    const began = beginning(incident.moments);
    setShape(this.shape, incident.state);
    setAttribute(this.element, "data-state", incident.state);
    setText(this.when, known(began) ? `${day(began, now)} ${clock(began)}`.trim() : "");
    setText(this.what, `${incident.service}: ${plain(incident.kind)}`);
    setText(this.outcome, outcome(incident));
    this.fill();
  }

  /** What a closed one holds is made when it is opened. */
  fill() {
    if (!this.details.open || this.filled === this.signature) return;
    this.filled = this.signature;
    const had = document.activeElement;
    const at = [...this.rest.querySelectorAll("li")].indexOf(had);
    this.rest.replaceChildren(...story(this.incident), this.values);
    if (at >= 0) this.rest.querySelectorAll("li")[at].focus();
  }
}

/** The first moment that is known: the others are told from it. */
function beginning(moments) {
  if (known(moments.last_good)) return moments.last_good;
  return Math.min(...MOMENTS.map(([name]) => moments[name]).filter(known));
}

function outcome(incident) {
  const { last_good: good, detected, first_message: first, returned, ended } = incident.moments;
  const from = known(good) ? good : detected;
  if (known(first) && known(from)) {
    const over = known(ended) ? `; over after ${span(ended - from)}` : "";
    return `taken over after ${span(first - from)}${over}`;
  }
  const back = known(returned) ? returned : ended;
  if (known(back) && known(from)) return `the original came back after ${span(back - from)}`;
  if (incident.missing.length) return `nothing replaces it; missing: ${list(incident.missing)}`;
  return word(incident.state).toLowerCase();
}

function story(incident) {
  const base = beginning(incident.moments);
  const at = ([name]) => incident.moments[name] ?? Infinity;
  const inOrder = [...MOMENTS].sort((one, other) => (at(one) < at(other) ? -1 : at(one) > at(other)));
  const steps = inOrder.map(([name, says]) => step(says, incident.moments[name], base));
  const { quality } = incident;
  const told = [
    ["Why", incident.evidence],
    ["Faulty node", incident.faulty_node],
    ["Told last", incident.detail],
    ["Substitute", incident.substitute],
    ["Inputs", incident.inputs.join(", ")],
    ["Relations", incident.relations.join(", ")],
    ["Quality", incident.substitute && known(quality) ? `${short(quality, 3)} of 1` : ""],
    ["Expected error", errors(incident)],
    ["Missing", incident.missing.join(", ")],
    ["Lost", incident.lost.join(", ")],
    ["Decision", incident.decision],
    ["Its bag", known(base) ? cut(base, incident.moments.ended) : ""],
  ];
  return [
    picture(incident.moments, base),
    make("ol", { class: "moments", "aria-label": "Its moments" }, ...steps),
    facts(told),
  ];
}

/** The command that cuts a recording to the time around an incident. */
function cut(began, ended) {
  const from = (began - AROUND_S).toFixed(1);
  const to = ((ended ?? began) + AROUND_S).toFixed(1);
  return `rosbag filter drive.bag incident.bag "${from} <= t.to_sec() <= ${to}"`;
}

function errors(incident) {
  const few = (error) => short(error, 2);
  const within = incident.error_p95.filter(known).map((each) => `± ${few(each)} in 95 %`);
  const rms = incident.error_rms.filter(known).map((each) => `${few(each)} rms`);
  return [...within, ...rms].join(", ");
}

function step(says, moment, base) {
  const name = make("span", {}, says);
  if (!known(moment)) return make("li", {}, name, make("b", {}, "–"));
  const told = moment === base ? "0" : `+${span(moment - base)}`.replace("+−", "−");
  const at = make("time", { class: "clock", datetime: new Date(moment * 1000).toISOString() });
  at.textContent = exactClock(moment);
  return make("li", { tabindex: "0" }, name, make("b", {}, told), at);
}

/** The moments on a line from 1 ms to a quarter of an hour; its scale is logarithmic. */
function picture(moments, base) {
  const box = { viewBox: "-4 0 308 30", "aria-hidden": "true" };
  const line = draw("svg", { class: "line-of-moments", ...box });
  const place = (seconds) => {
    const decade = Math.log10(Math.max(seconds, 10 ** FIRST_DECADE)) - FIRST_DECADE;
    return Math.min(1, decade / DECADES) * 300;
  };
  line.append(draw("path", { class: "axis", d: "M0 11H300" }));
  ["1 ms", "10 ms", "0.1 s", "1 s", "10 s", "100 s"].forEach((label, index) => {
    const x = (index * 300) / DECADES;
    line.append(draw("path", { class: "axis", d: `M${x} 8v6` }), draw("text", { x, y: 26 }, label));
  });
  const gap = moments.first_message ?? moments.returned ?? moments.ended;
  if (known(gap)) line.append(draw("path", { class: "gap", d: `M0 11H${place(gap - base)}` }));
  if (known(moments.first_message)) {
    const end = moments.returned ?? moments.ended;
    const to = known(end) ? place(end - base) : 300;
    const from = place(moments.first_message - base);
    line.append(draw("path", { class: "stood-in", d: `M${from} 11H${to}` }));
  }
  for (const [name] of MOMENTS) {
    if (!known(moments[name])) continue;
    line.append(draw("circle", { cx: place(moments[name] - base), cy: 11, r: 3, class: name }));
  }
  return line;
}
