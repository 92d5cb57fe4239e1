// The ontology: laid out once by the server, here only classes are switched.
import { ask } from "./connection.js";
import { byId, draw, make, makeStop, roving, setAttribute, setText } from "./page.js";
import { plusMinus, unit, word } from "./words.js";

const KINDS = ["service", "property", "relation"];
const ALIVE = new Set(["well", "starting", "kept"]);
const ZOOM = 1.3;
const READABLE = 0.6;
const LARGEST_FIT = 1.2;
const PX_PER_PT = 4 / 3;
const FRAME_PX = 28;
const NOTE_PT = 10;
const FORBIDDEN = "script, style, foreignObject, image, use, animate, set, iframe";

export class Graph {
  constructor(asked) {
    this.frame = byId("graph");
    this.asked = asked;
    this.nodes = new Map();
    this.edges = [];
    this.would = new Set();
    this.number = 0;
    byId("smaller").addEventListener("click", () => this.zoom(1 / ZOOM));
    byId("larger").addEventListener("click", () => this.zoom(ZOOM));
    byId("fit").addEventListener("click", () => this.fit(0));
    this.frame.addEventListener("click", (event) => this.choose(event.target));
    this.frame.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      this.choose(event.target);
    });
    roving(this.frame, ".node", (from, key) => this.neighbour(from, key));
  }

  /** Takes the picture anew from the server. */
  async load(whole) {
    this.number += 1;
    const number = this.number;
    try {
      const answer = await ask("api/graph", { limit: 20000 });
      if (number !== this.number) return;
      if (answer.error || !answer.svg) throw new Error(answer.error || "There is no drawing.");
      if (answer.svg !== this.source) this.take(answer);
    } catch (error) {
      if (number === this.number && !this.source) {
        const why = `No drawing of the ontology: ${error.message}`;
        this.frame.replaceChildren(make("p", { class: "quiet" }, why));
      }
    }
    this.show(whole);
  }

  take({ svg, edges }) {
    const parsed = new DOMParser().parseFromString(svg, "image/svg+xml");
    if (parsed.documentElement.nodeName !== "svg") throw new Error("The drawing cannot be read.");
    this.source = svg;
    clean(parsed.documentElement);
    const picture = document.importNode(parsed.documentElement, true);
    this.picture = picture;
    this.width = picture.viewBox.baseVal.width;
    this.frame.replaceChildren(picture);
    this.nodes = new Map();
    for (const element of picture.querySelectorAll("g[id]")) {
      const node = new Node(element);
      if (node.kind) this.nodes.set(element.id, node);
    }
    this.edges = edges
      .map((edge) => ({ ...edge, element: picture.getElementById(edge.id) }))
      .filter((edge) => edge.element);
    makeStop(this.frame, ".node", this.frame.querySelector(".node"));
    this.fit(READABLE);
    this.frame.scrollLeft = (this.frame.scrollWidth - this.frame.clientWidth) / 2;
  }

  /** As wide as the frame, but not smaller than `least` of its own size. */
  fit(least) {
    if (!this.picture) return;
    const fitting = (this.frame.clientWidth - FRAME_PX) / (this.width * PX_PER_PT);
    this.resize(Math.min(LARGEST_FIT, Math.max(least, fitting)));
  }

  zoom(factor) {
    if (this.picture) this.resize(Math.min(4, Math.max(0.1, this.scale * factor)));
  }

  resize(scale) {
    this.scale = scale;
    this.picture.setAttribute("width", Math.floor(this.width * PX_PER_PT * scale));
    this.picture.removeAttribute("height");
  }

  show(whole) {
    if (!this.picture) return;
    const { services } = whole;
    const runs = derivationsOf(services);
    const properties = judge(services);
    for (const [id, node] of this.nodes) {
      const told = node.kind === "service" ? services[node.name] : properties.get(id);
      const { state = "idle", error = "" } = told || {};
      node.show({ state, error, runs: runs.has(id), would: this.would.has(id) });
    }
    for (const edge of this.edges) {
      const from = this.nodes.get(edge.from);
      const provides = from && from.kind === "service" && from.state !== "idle";
      const flags = {
        runs: together(runs.get(edge.from), runs.get(edge.to)),
        gone: provides && !ALIVE.has(from.state),
        would: this.would.has(edge.from) && this.would.has(edge.to),
      };
      setAttribute(edge.element, "class", classes("edge", flags));
    }
    setText(byId("losses"), losses(services));
  }

  /** Marks what would run: the ids of a what-if, or none. */
  propose(ids, whole) {
    this.would = new Set(ids);
    this.show(whole);
  }

  choose(target) {
    const element = target.closest(".node");
    const node = element && this.nodes.get(element.id);
    if (!node) return;
    if (node.kind === "service") this.asked("service", node.name);
    else if (node.kind === "property") {
      const from = this.edges
        .filter((edge) => edge.to === element.id)
        .map((edge) => this.nodes.get(edge.from))
        .find((each) => each && each.kind === "service");
      if (from) this.asked("service", from.name);
    }
  }

  /** The nearest node in the direction of an arrow key. */
  neighbour(from, key) {
    const sideways = key === "ArrowLeft" || key === "ArrowRight";
    const sign = key === "ArrowRight" || key === "ArrowDown" ? 1 : -1;
    const here = middle(from);
    let best = null;
    let least = Infinity;
    for (const { element } of this.nodes.values()) {
      const there = middle(element);
      const along = sign * (sideways ? there.x - here.x : there.y - here.y);
      const across = Math.abs(sideways ? there.y - here.y : there.x - here.x);
      const distance = along + 3 * across;
      if (along > 1 && distance < least) [best, least] = [element, distance];
    }
    return best;
  }
}

class Node {
  constructor(element) {
    this.element = element;
    this.kind = KINDS.find((kind) => element.id.startsWith(`${kind}-`));
    if (!this.kind) return;
    this.name = element.id.slice(this.kind.length + 1);
    this.state = "";
    this.cost = null;
    element.querySelectorAll("title").forEach((title) => title.remove());
    this.title = draw("title");
    element.prepend(this.title);
    element.querySelectorAll("text").forEach((text) => setText(text, unit(text.textContent)));
    setAttribute(element, "tabindex", "-1");
    setAttribute(element, "role", this.kind === "relation" ? "img" : "button");
  }

  show({ state, runs, would, error }) {
    this.state = state;
    setAttribute(this.element, "class", classes(`node ${this.kind}`, { runs, would }));
    setAttribute(this.element, "data-state", state);
    const parts = [
      state === "idle" ? "" : word(state).toLowerCase(),
      error,
      runs && this.kind === "relation" ? "runs now" : "",
      would ? "would run" : "",
    ];
    const says = `${this.kind} ${this.name}: ${parts.filter(Boolean).join(", ") || "not in use"}`;
    setAttribute(this.element, "aria-label", says);
    setText(this.title, says);
    this.note(state === "derived" ? error || "derived" : state === "lost" ? "lost" : "");
  }

  /** A few words below: what it costs that this is derived. */
  note(text) {
    if (!this.cost) {
      if (!text) return;
      const box = this.element.getBBox();
      const place = { x: box.x + box.width / 2, y: box.y + box.height + NOTE_PT };
      this.cost = draw("text", { class: "cost", ...place });
      this.element.append(this.cost);
    }
    setText(this.cost, text);
  }
}

/** The services whose derivation an element is in, by its id. */
function derivationsOf(services) {
  const found = new Map();
  for (const [name, { derivation }] of Object.entries(services)) {
    for (const id of derivation) {
      if (!found.has(id)) found.set(id, new Set());
      found.get(id).add(name);
    }
  }
  return found;
}

/** Whether one derivation has both; the smaller set is looked through. */
function together(some, others) {
  if (!some || !others) return false;
  const [fewer, more] = some.size < others.size ? [some, others] : [others, some];
  return [...fewer].some((name) => more.has(name));
}

/** What each property is: measured, derived or lost; with the error where it is derived. */
function judge(services) {
  const judged = new Map();
  for (const service of Object.values(services)) {
    for (const [name, property] of Object.entries(service.properties)) {
      const id = `property-${name}`;
      if (ALIVE.has(service.state)) judged.set(id, { state: "measured" });
      if (judged.has(id) && judged.get(id).state === "measured") continue;
      if (service.state === "unknown") continue;
      const error = plusMinus(property.error_p95, property.error_rms);
      const derived = service.derivation.includes(id);
      const cost = error && `${error} ${unit(property.unit)}`;
      judged.set(id, derived ? { state: "derived", error: cost } : { state: "lost" });
    }
  }
  return judged;
}

function losses(services) {
  const told = [];
  for (const [name, service] of Object.entries(services)) {
    if (ALIVE.has(service.state) || service.state === "unknown") continue;
    for (const [property, value] of Object.entries(service.properties)) {
      const error = plusMinus(value.error_p95, value.error_rms);
      const cost = service.substitute
        ? `derived instead, ${error ? `${error} ${unit(value.unit)}` : "error not known"}`
        : "not derived";
      told.push(`${property} of ${name} is lost; ${cost}.`);
    }
  }
  if (told.length) return told.join(" ");
  return "Nothing is lost. Thin lines show what could replace a value.";
}

/** What the server draws is shapes and text; nothing in it may act or load. */
function clean(picture) {
  picture.querySelectorAll(FORBIDDEN).forEach((element) => element.remove());
  for (const element of [picture, ...picture.querySelectorAll("*")]) {
    for (const { name } of [...element.attributes]) {
      if (/^on|^style$|href$/i.test(name)) element.removeAttribute(name);
    }
  }
  picture.querySelectorAll("a").forEach((anchor) => anchor.replaceWith(...anchor.childNodes));
  setAttribute(picture, "role", "group");
  setAttribute(picture, "aria-label", "Ontology");
}

function classes(always, flags) {
  return [always, ...Object.keys(flags).filter((name) => flags[name])].join(" ");
}

function middle(element) {
  const box = element.getBoundingClientRect();
  return { x: box.x + box.width / 2, y: box.y + box.height / 2 };
}
