// One service or node: why it is as it is, what to do, its values, and what if it failed.
import { ask } from "./connection.js";
import { byId, facts, make, setText } from "./page.js";
import { Values } from "./values.js";
import { clock, known, list, plain, plusMinus, short, unit } from "./words.js";

const LIMIT_MS = 15000;
const MOST_SETS = 12;

export class WhatIf {
  /** `shown(ids)` gets the elements of the graph that would run; `closed()` follows. */
  constructor({ shown, actions }) {
    this.dialog = byId("what-if");
    this.shown = shown;
    this.actions = actions;
    this.number = 0;
    this.values = new Values();
    byId("close").addEventListener("click", () => this.close());
    this.dialog.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.close();
    });
  }

  /** Shows a service with its values around an incident. */
  openIncident(key, robot) {
    const incident = robot.incidents.find((each) => each.key === key);
    if (incident && Object.hasOwn(robot.services, incident.service)) {
      this.open("service", incident.service, robot, incident);
    }
  }

  async open(what, name, robot, incident = null) {
    this.number += 1;
    const number = this.number;
    if (!this.dialog.open) this.before = document.activeElement;
    const question = what === "node" ? `What if the node ${name} died?` : `What if ${name} failed?`;
    setText(byId("question"), question);
    byId("answer").replaceChildren(make("p", { class: "quiet" }, "Searching …"));
    if (!this.dialog.open) this.dialog.show();
    byId("about").focus();
    this.showNow(what, name, robot, incident);
    this.actions.offer(what === "service" ? robot.services[name] : null);
    const address = `api/what_if?${what}=${encodeURIComponent(name)}`;
    try {
      const answer = await ask(address, { limit: LIMIT_MS });
      if (number !== this.number) return;
      byId("answer").replaceChildren(...told(answer, robot));
      this.shown(would(answer, robot));
    } catch (error) {
      if (number !== this.number) return;
      byId("answer").replaceChildren(make("p", { class: "refused" }, error.message));
      this.shown([]);
    }
  }

  showNow(what, name, robot, incident) {
    const service = what === "service" ? robot.services[name] : null;
    setText(byId("about"), incident ? `${name}: ${plain(incident.kind)}` : name);
    byId("now").replaceChildren(...(service ? state(service, incident) : []));
    if (service) this.values.open(name, robot, incident);
    else this.values.close();
  }

  close() {
    this.number += 1;
    this.values.close();
    this.dialog.close();
    this.shown([]);
    if (this.before && this.before.isConnected) this.before.focus();
  }
}

/** Why a service is as it is, and what people can do. */
export function state(service, incident = null) {
  const began = incident && incident.moments.detected;
  const pairs = incident
    ? [["Why", incident.evidence || incident.detail], ["Seen", known(began) ? clock(began) : ""]]
    : [["Why", service.why]];
  return [facts([...pairs, ["Decision", incident && incident.decision]]), ...remedies(service)];
}

/** What to do, each with the command or the line of the file. */
export function remedies(service) {
  if (!service.remedies || !service.remedies.length) return [];
  const items = service.remedies.map(({ text, command }) =>
    make("li", {}, text, ...(command ? [make("code", {}, command)] : [])),
  );
  return [make("h3", {}, "What to do"), make("ol", { class: "remedies" }, ...items)];
}

function told(answer, robot) {
  const parts = answer.services.map((each) => section(each, robot));
  if (!parts.length) parts.push(make("p", {}, "No service is lost."));
  const left = make("p", { class: "left" }, answer.left || "Not known.");
  parts.push(make("h3", {}, "What is left then"), left);
  parts.push(...sets(answer.cut_sets || []));
  return parts;
}

function section(each, robot) {
  const service = Object.hasOwn(robot.services, each.service) ? robot.services[each.service] : null;
  const verdict = each.found ? "would be taken over" : "nothing could replace it";
  const pairs = [
    ["From", list(each.inputs, "")],
    ["By", list(each.relations, "")],
    ["Expected error", each.found ? errors(each, service) : ""],
    ["Quality", each.found && known(each.quality) ? `${short(each.quality, 3)} of 1` : ""],
    ["Missing", list(each.missing, "")],
    ["Its node", service && service.fate],
    ["", each.detail],
  ];
  const found = each.found ? "yes" : "no";
  const head = make("h3", { "data-found": found }, `${each.service}: ${verdict}`);
  const parts = [head, facts(pairs)];
  if (each.code) {
    const code = make("pre", { tabindex: "0", "aria-label": "Its code" }, each.code);
    parts.push(make("details", {}, make("summary", {}, "The code that would run"), code));
  }
  return make("section", {}, ...parts);
}

function errors({ error_p95: p95 = [], error_rms: rms = [] }, service) {
  const properties = service ? Object.entries(service.properties) : [];
  const count = Math.max(p95.length, rms.length);
  const parts = [];
  for (let index = 0; index < count; index += 1) {
    const error = plusMinus(p95[index], rms[index]) || "not known";
    const [name, property] = properties.length === count ? properties[index] : ["", { unit: "" }];
    parts.push(`${name} ${error} ${unit(property.unit)}`.trim());
  }
  return parts.join(", ") || "not known";
}

function sets(cutSets) {
  if (!cutSets.length) return [];
  const items = cutSets.slice(0, MOST_SETS).map((causes) => make("li", {}, causes.join(" and ")));
  const more = cutSets.length - MOST_SETS;
  if (more > 0) items.push(make("li", { class: "quiet" }, `and ${more} more`));
  return [
    make("h3", {}, "Lost for good if these fail together"),
    make("ul", { class: "sets" }, ...items),
  ];
}

/** The elements of the graph that would run: what yields the lost properties by which relation. */
function would(answer, robot) {
  const ids = [];
  for (const each of answer.services.filter(({ found }) => found)) {
    const service = robot.services[each.service];
    for (const property of service ? Object.keys(service.properties) : []) {
      ids.push(`property-${property}`);
      ids.push(...each.relations.map((relation) => `relation-${relation}-${property}`));
    }
  }
  return ids;
}
