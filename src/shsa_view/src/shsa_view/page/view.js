// The live view: one document, kept up by the stream of events; each part shows what of it changed.
import { Actions } from "./actions.js";
import { Connection } from "./connection.js";
import { Glance, title } from "./glance.js";
import { Graph } from "./graph.js";
import { Hour } from "./hour.js";
import { Incidents } from "./incidents.js";
import { byId, setText } from "./page.js";
import { Services } from "./services.js";
import { WhatIf } from "./what_if.js";
import { clock, span } from "./words.js";

const VERSION = 1;
const SPOKEN_EVERY_MS = 3000;

class View {
  constructor() {
    this.document = null;
    this.dirty = new Set();
    this.names = new Set();
    this.lostAt = null;
    this.spokenAt = 0;
    const asked = (what, name) => this.whatIf.open(what, name, this.document);
    this.actions = new Actions();
    this.whatIf = new WhatIf({
      shown: (ids) => this.graph.propose(ids, this.document),
      actions: this.actions,
    });
    this.glance = new Glance(asked);
    this.services = new Services(asked);
    const askedIncident = (key) => this.whatIf.openIncident(key, this.document);
    this.incidents = new Incidents(askedIncident);
    this.hour = new Hour(askedIncident);
    this.graph = new Graph(asked);
    this.connection = new Connection({
      heard: (whole) => this.heard(whole),
      changed: (changes) => this.changed(changes),
      lost: () => this.lost(),
    });
    setInterval(() => this.tick(), 1000);
  }

  heard(whole) {
    const first = this.lostAt !== null || this.document === null;
    this.document = whole;
    this.lostAt = null;
    this.actions.allowed = whole.actions === true;
    if (first) this.graph.load(whole);
    if (first) this.hour.look();
    this.names = null;
    this.plan(["robot", "services", "incidents", "graph"]);
    this.showConnection();
  }

  changed(changes) {
    const { now, services, incidents, ...others } = changes;
    const whole = this.document;
    if (now) whole.now = now;
    Object.assign(whole, others);
    patch(whole.services, services);
    if (incidents) {
      whole.incidents = merged(whole.incidents, incidents);
      this.hour.look();
    }
    if (services && this.names) Object.keys(services).forEach((name) => this.names.add(name));
    this.plan([
      "robot",
      ...(services ? ["services", "graph"] : []),
      ...(incidents ? ["incidents"] : []),
    ]);
  }

  /** Shows what is dirty with the next picture that the browser paints. */
  plan(parts) {
    if (!this.dirty.size) requestAnimationFrame(() => this.show());
    parts.forEach((part) => this.dirty.add(part));
    document.title = title(this.document);
    this.speak(this.document.robot.text);
  }

  show() {
    const { dirty, names } = this;
    this.dirty = new Set();
    this.names = new Set();
    setText(byId("namespace"), this.document.namespace);
    if (dirty.has("robot")) this.glance.show(this.document);
    if (dirty.has("services")) this.services.show(this.document, names);
    if (dirty.has("graph")) this.graph.show(this.document);
    if (dirty.has("incidents")) this.incidents.show(this.document);
  }

  lost() {
    if (this.lostAt === null) this.lostAt = Date.now() / 1000;
    this.showConnection();
  }

  tick() {
    this.showConnection();
    if (this.document && this.lostAt === null) this.speak(this.document.robot.text);
  }

  showConnection() {
    const { lostAt } = this;
    const older = this.document && this.document.version !== VERSION;
    const state = this.document ? "live" : "opening";
    document.documentElement.dataset.connection = lostAt ? "lost" : state;
    const live = this.document ? `Live, ${clock(this.document.now)}` : "Connecting";
    setText(byId("connection-text"), lostAt ? "Connection lost" : live);
    byId("lost").hidden = !lostAt && !older;
    if (lostAt) {
      const what = this.document ? "The page shows the robot as it was then. " : "";
      setText(byId("lost"), `Connection lost since ${clock(lostAt)}. ${what}Trying again.`);
      document.title = `Connection lost – ${span(Math.round(Date.now() / 1000 - lostAt))}`;
    } else if (older) {
      setText(byId("lost"), "The server is of another version than this page. Please reload it.");
    }
  }

  /** Tells a screen reader how the robot is: when that changes, and not all the time. */
  speak(text) {
    const now = performance.now();
    if (text === byId("spoken").textContent || now - this.spokenAt < SPOKEN_EVERY_MS) return;
    this.spokenAt = now;
    setText(byId("spoken"), text);
  }
}

/** Rows that are null are gone. */
function patch(rows, changes) {
  for (const [name, row] of Object.entries(changes || {})) {
    if (row === null) delete rows[name];
    else rows[name] = row;
  }
}

/** The newest first; one that is known changes where it stands. */
function merged(incidents, changes) {
  const changed = new Map(changes.map((each) => [each.key, each]));
  const kept = incidents.map((each) => {
    const now = changed.get(each.key) || each;
    changed.delete(each.key);
    return now;
  });
  return [...changed.values(), ...kept];
}

/** A link within the page moves the focus; the address, which may hold a token, stays as it is. */
document.querySelector(".skips").addEventListener("click", (event) => {
  const link = event.target.closest("a");
  if (!link) return;
  event.preventDefault();
  const section = byId(link.getAttribute("href").slice(1));
  section.focus();
  section.scrollIntoView();
});

new View();
