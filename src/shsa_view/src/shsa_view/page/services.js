// A row for each service; what needs attention stands first. Only what changed is touched.
import { byId, make, makeStop, roving } from "./page.js";
import { setAttribute, setName, setShape, setText, shape } from "./page.js";
import { Strip } from "./strip.js";
import { known, measured, short, word } from "./words.js";

const ATTENTION = [
  ...["failed", "not_healed", "healing", "kept", "substituted"],
  ...["returning", "unknown", "starting", "well"],
];
const FILTERED_FROM = 12;

/** Where a state stands in the order of attention: the smaller, the more urgent. */
export function urgency(state) {
  const index = ATTENTION.indexOf(state);
  return index < 0 ? ATTENTION.indexOf("unknown") : index;
}

export class Services {
  /** `ask(what, name)` is called when somebody asks about a "service" or a "node". */
  constructor(ask) {
    this.body = byId("rows");
    this.rows = new Map();
    this.ask = ask;
    this.filter = byId("filter");
    this.filter.addEventListener("input", () => this.sift());
    roving(this.body, "button", (from, key) => this.neighbour(from, key));
  }

  /** Shows these services of the document; `names` null: all. */
  show(whole, names) {
    const services = whole.services;
    let moved = false;
    for (const name of names || new Set([...this.rows.keys(), ...Object.keys(services)])) {
      moved = this.showOne(name, Object.hasOwn(services, name) ? services[name] : null) || moved;
    }
    if (!moved) return;
    this.sort();
    this.count();
    this.sift();
    if (!this.body.querySelector('button[tabindex="0"]')) {
      makeStop(this.body, "button", this.body.querySelector("button"));
    }
  }

  /** Returns whether the order may be another one now. */
  showOne(name, service) {
    let row = this.rows.get(name);
    if (service === null) {
      if (row) row.element.remove();
      return this.rows.delete(name);
    }
    if (!row) {
      row = new Row(name, this.ask);
      this.rows.set(name, row);
    }
    return row.show(service);
  }

  sort() {
    const focused = document.activeElement;
    const rank = (row) => urgency(row.state);
    const order = [...this.rows.values()].sort(
      (one, other) => rank(one) - rank(other) || one.name.localeCompare(other.name),
    );
    order.forEach(({ element }, index) => {
      const there = this.body.children[index];
      if (there !== element) this.body.insertBefore(element, there || null);
    });
    if (focused !== document.activeElement && this.body.contains(focused)) focused.focus();
  }

  count() {
    const counts = new Map();
    for (const { state } of this.rows.values()) counts.set(state, (counts.get(state) || 0) + 1);
    const parts = [...counts]
      .sort(([one], [other]) => urgency(one) - urgency(other))
      .map(([state, count]) => `${count} ${word(state).toLowerCase()}`);
    setText(byId("services-count"), parts.join(" · "));
    byId("filter-label").hidden = this.rows.size < FILTERED_FROM && !this.filter.value;
  }

  sift() {
    const wanted = this.filter.value.trim().toLowerCase();
    for (const row of this.rows.values()) row.element.hidden = !row.text.includes(wanted);
  }

  neighbour(from, key) {
    const row = from.closest("tr");
    const buttons = [...row.querySelectorAll("button")];
    const column = buttons.indexOf(from);
    if (key === "ArrowLeft" || key === "ArrowRight") {
      return buttons[column + (key === "ArrowRight" ? 1 : -1)];
    }
    const rows = [...this.body.children].filter((each) => !each.hidden);
    const other = rows[rows.indexOf(row) + (key === "ArrowDown" ? 1 : -1)];
    if (!other) return null;
    const there = other.querySelectorAll("button");
    return there[Math.min(column, there.length - 1)];
  }
}

/** Why a service that is well is not blamed; empty: there is nothing to blame it for. */
function spared(service) {
  return (service.why || "").includes("not blamed") ? service.why : "";
}

class Row {
  constructor(name, ask) {
    this.name = name;
    this.state = null;
    this.text = "";
    this.values = new Map();
    this.strip = new Strip();
    this.shape = shape("unknown");
    this.word = make("span");
    this.topic = make("span", { class: "topic" });
    this.detail = make("span", { class: "detail" });
    this.value = make("td", { role: "cell", class: "values" });
    this.rate = make("span", { class: "rate" });
    this.wanted = make("span", { class: "quiet" });
    this.publisher = make("button", { type: "button", class: "asks", tabindex: "-1" });
    const rate = make("span", { class: "pace" }, this.rate, this.wanted);
    const button = make("button", { type: "button", class: "asks name", tabindex: "-1" });
    setName(button, name);
    button.addEventListener("click", () => ask("service", name));
    this.publisher.addEventListener("click", () => {
      if (this.substituted) ask("service", name);
      else ask("node", this.publisher.textContent);
    });
    const row = make(
      "tr",
      { role: "row", "data-service": name },
      make("td", { role: "cell", class: "state" }, this.shape, this.word),
      make("th", { role: "rowheader", scope: "row" }, button, this.topic, this.detail),
      this.value,
      make("td", { role: "cell", class: "publisher" }, this.publisher, rate),
      make("td", { role: "cell", class: "minute" }, this.strip.element),
    );
    row.addEventListener("click", (event) => {
      if (!event.target.closest("button") && !getSelection().toString()) ask("service", name);
    });
    this.element = row;
  }

  show(service) {
    const moved = this.state !== service.state;
    if (moved) {
      this.state = service.state;
      setAttribute(this.element, "data-state", service.state);
      setShape(this.shape, service.state);
      setText(this.word, word(service.state));
    }
    this.substituted = service.publisher === service.substitute;
    setName(this.topic, service.topic);
    const told = service.state === "well" || service.substitute ? spared(service) : service.why;
    setText(this.detail, told);
    setText(this.rate, known(service.rate) ? short(service.rate, 3) : "–");
    const wanted = service.period ? ` of ${short(1 / service.period, 3)} Hz` : " Hz";
    setText(this.wanted, service.bridged ? `${wanted}, ${service.bridged} times late` : wanted);
    setName(this.publisher, service.publisher || "");
    this.publisher.hidden = !service.publisher;
    setAttribute(this.publisher, "title", service.host ? `on ${service.host}` : null);
    this.showValues(service.properties);
    this.strip.show(service.strip);
    this.text = `${this.name} ${service.topic} ${service.publisher} ${service.host}`.toLowerCase();
    return moved;
  }

  showValues(properties) {
    for (const [name, line] of this.values) {
      if (Object.hasOwn(properties, name)) continue;
      line.element.remove();
      this.values.delete(name);
    }
    for (const [name, property] of Object.entries(properties)) {
      let line = this.values.get(name);
      if (!line) {
        line = new Value(name);
        this.values.set(name, line);
        this.value.append(line.element);
      }
      line.show(property);
    }
  }
}

class Value {
  constructor(name) {
    this.value = make("b");
    this.error = make("span", { class: "error" });
    this.unit = make("span", { class: "unit" });
    const told = make("span", { class: "told" }, this.value, " ", this.error, " ", this.unit);
    const property = make("span", { class: "property" });
    setName(property, name);
    this.element = make("div", {}, property, " ", told);
  }

  show(property) {
    const { value, error, unit } = measured(property);
    setText(this.value, value);
    setText(this.error, error);
    setText(this.unit, unit);
  }
}
