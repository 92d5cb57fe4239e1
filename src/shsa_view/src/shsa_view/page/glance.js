// The robot at a glance: how it is, what failed, what stands in, how far to trust it, what is left.
import { ask } from "./connection.js";
import { byId, facts, make, setAttribute, setText, shape } from "./page.js";
import { urgency } from "./services.js";
import { remedies } from "./what_if.js";
import { clock, known, list, plain, plusMinus, short, unit, word } from "./words.js";

const CARDS = 6;
const WHAT_IF_MS = 15000;
const AS_IT_SHOULD_BE = new Set(["well", "starting", "unknown"]);
const TITLES = {
  well: "All well",
  substituted: "Substituted",
  not_healed: "Not healed",
  starting: "Starting",
  unknown: "Not known",
};
const SIGNS = { well: "✓", substituted: "◆", not_healed: "✕" };

/** The incident that a service is in. */
export function incidentOf(whole, name) {
  const key = whole.services[name].incident_key;
  return (key && whole.incidents.find((each) => each.key === key)) || null;
}

/** What the page is called: seen in the browser's tab. */
export function title(whole) {
  const { state } = whole.robot;
  const sign = SIGNS[state] ? `${SIGNS[state]} ` : "";
  return `${sign}${heading(whole.robot)} – ${whole.namespace}`;
}

/** The state of the robot: "All well" only where its text says so too. */
function heading({ state, text }) {
  if (state === "well" && !text.startsWith(TITLES.well)) return "Well";
  return TITLES[state] || plain(state);
}

export class Glance {
  constructor(asked) {
    this.asked = asked;
    this.cards = new Map();
    this.state = null;
  }

  show(whole) {
    const { state, text } = whole.robot;
    if (state !== this.state) {
      this.state = state;
      byId("glance").dataset.state = state;
      byId("robot-shape").replaceChildren(shape(state));
    }
    setText(byId("robot-state"), heading(whole.robot));
    setText(byId("robot-text"), text);
    this.showHealing(whole);
    this.showAffected(whole);
  }

  showHealing(whole) {
    const { text: told, ...parts } = whole.healing;
    const text = [told, doubt(whole.trust)].filter(Boolean).join("; ");
    const all = Object.entries(parts).map(([name, state]) => [name, state, ""]);
    for (const [name, host] of Object.entries(whole.hosts)) all.push([name, host.state, host.text]);
    const signature = JSON.stringify([all, text]);
    if (signature === this.healing) return;
    this.healing = signature;
    const items = all.map(([name, state, more]) => {
      const well = state === "alive" || state === "heard";
      const mark = shape(well ? "well" : state === "lost" ? "failed" : "unknown");
      return make("li", { title: more || null }, mark, `${plain(name)} ${plain(state)}`);
    });
    if (text) items.push(make("li", { class: "told" }, text));
    byId("healing").replaceChildren(...items);
  }

  showAffected(whole) {
    const rank = (name) => urgency(whole.services[name].state);
    const names = Object.keys(whole.services)
      .filter((name) => !AS_IT_SHOULD_BE.has(whole.services[name].state))
      .sort((one, other) => rank(one) - rank(other) || one.localeCompare(other));
    const shown = names.slice(0, CARDS);
    const cards = shown.map((name) => this.card(whole, name));
    for (const name of this.cards.keys()) if (!shown.includes(name)) this.cards.delete(name);
    const wanted = cards.map((card) => card.element);
    if (names.length > CARDS) wanted.push(this.more(names.length - CARDS));
    const place = byId("affected");
    const there = [...place.children];
    const same = wanted.length === there.length && wanted.every((each, at) => each === there[at]);
    if (!same) place.replaceChildren(...wanted);
  }

  more(count) {
    const text = `and ${count} more: see the services`;
    this.rest = this.rest || make("li", { class: "rest" });
    setText(this.rest, text);
    return this.rest;
  }

  card(whole, name) {
    let card = this.cards.get(name);
    if (!card) {
      card = new Card(name, this.asked);
      this.cards.set(name, card);
    }
    card.show(whole.services[name], incidentOf(whole, name), whole.substitutes);
    return card;
  }
}

class Card {
  constructor(name, asked) {
    this.name = name;
    this.shape = make("span");
    this.word = make("span", { class: "word" });
    this.since = make("span", { class: "quiet" });
    this.facts = make("div");
    this.left = make("span", {}, "…");
    this.question = "";
    const button = make("button", { type: "button", class: "asks name" }, name);
    button.addEventListener("click", () => asked("service", name));
    const head = make("h3", {}, this.shape, button, " ", this.word, " ", this.since);
    this.element = make("li", {}, head, this.facts);
  }

  show(service, incident, substitutes) {
    setAttribute(this.element, "data-state", service.state);
    const told = [
      ["What failed", failed(service, incident)],
      ["Why", (incident && incident.evidence) || ""],
      ["What replaces it", standsIn(this.name, service, incident, substitutes)],
      ["How far to trust it", trust(service, incident)],
    ];
    const began = incident && incident.moments.detected;
    const signature = JSON.stringify([told, service.state, began, service.remedies]);
    if (signature === this.signature) return;
    this.signature = signature;
    this.shape.replaceChildren(shape(service.state));
    setText(this.word, word(service.state));
    setText(this.since, known(began) ? `since ${clock(began)}` : "");
    if (service.substitute) {
      told.push(["If this died too", this.left]);
      this.look(service.substitute);
    }
    this.facts.replaceChildren(facts(told), ...remedies(service));
  }

  /** Asks what is left then, once for each substitute. */
  async look(question) {
    if (question === this.question) return;
    this.question = question;
    const address = `api/what_if?service=${encodeURIComponent(this.name)}`;
    try {
      const answer = await ask(address, { limit: WHAT_IF_MS });
      if (question === this.question) setText(this.left, answer.left || "Not known.");
    } catch (error) {
      if (question === this.question) setText(this.left, `Not known: ${error.message}`);
    }
  }
}

/** Why not everything that is shown can be believed. */
function doubt(trust) {
  return !trust || trust.state === "checked" ? "" : trust.text;
}

function failed(service, incident) {
  if (!incident) return service.detail || `Not known: ${service.topic}`;
  const detail = incident.detail && !service.substitute ? `: ${incident.detail}` : "";
  return `${incident.faulty_node || service.topic} – ${plain(incident.kind)}${detail}`;
}

function standsIn(name, service, incident, substitutes) {
  if (!service.substitute) {
    if (service.state === "healing") return "Nothing yet; a substitute is searched or started.";
    const lacks = incident && incident.missing.length;
    return lacks ? `Nothing. Missing: ${list(incident.missing)}.` : "Nothing.";
  }
  const { substitute } = service;
  // Where several share a process, a row goes by the service as well.
  const key = [substitute, `${substitute} ${name}`].find((each) => Object.hasOwn(substitutes, each));
  const row = key === undefined ? incident : substitutes[key];
  if (!row) return substitute;
  return `${substitute}, from ${list(row.inputs)} by ${list(row.relations)}`;
}

function trust(service, incident) {
  if (!service.substitute) return "There is no value.";
  const parts = Object.entries(service.properties).map(([name, property]) => {
    const error = plusMinus(property.error_p95, property.error_rms);
    return error ? `${name} ${error} ${unit(property.unit)}` : `${name}: error not known`;
  });
  if (incident && known(incident.quality)) {
    return `${parts.join(", ")}; quality ${short(incident.quality, 2)} of 1`;
  }
  return parts.join(", ");
}
