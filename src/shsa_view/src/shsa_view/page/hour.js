// The last hour of the whole robot: a line for each service, and what failed.
import { ask } from "./connection.js";
import { byId, draw, make, setText } from "./page.js";
import { clock, plain, span, word } from "./words.js";

const EVERY_MS = 10000;
const HEIGHT = 14;
const WIDTH = 1000;
const HEIGHTS = { well: 4, substituted: 8, healing: 11, not_healed: 14, unknown: 2 };
const LABELS = 5;

export class Hour {
  /** `asked(key)` is called when somebody asks about an incident. */
  constructor(asked) {
    this.asked = asked;
    this.rows = byId("hour-rows");
    this.minutes = 60;
    this.told = null;
    for (const button of document.querySelectorAll("#hour [data-minutes]")) {
      button.addEventListener("click", () => this.zoom(button));
    }
    setInterval(() => this.look(), EVERY_MS);
  }

  zoom(button) {
    this.minutes = Number(button.dataset.minutes);
    for (const each of document.querySelectorAll("#hour [data-minutes]")) {
      each.setAttribute("aria-pressed", String(each === button));
    }
    if (this.told) this.show();
  }

  async look() {
    if (document.hidden) return;
    try {
      this.told = await ask("api/timeline.json");
      this.show();
    } catch {
      // The connection says what is wrong.
    }
  }

  show() {
    const { now, services, incidents } = this.told;
    const since = now - this.minutes * 60;
    const place = (time) => ((Math.max(time, since) - since) / (now - since)) * WIDTH;
    const marks = new Map(Object.keys(services).map((name) => [name, []]));
    for (const each of incidents) {
      if (each.from >= since && marks.has(each.service)) marks.get(each.service).push(each);
    }
    const rows = [...marks].map(([name, own]) => this.row(name, services[name], own, place, now));
    this.rows.replaceChildren(...rows, axis(since, now));
    const count = incidents.length;
    setText(byId("hour-count"), count === 1 ? "1 incident" : `${count || "no"} incidents`);
  }

  row(name, runs, incidents, place, now) {
    const box = { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none" };
    const strip = draw("svg", { ...box, role: "img", "aria-label": spoken(name, runs, now) });
    runs.forEach(([from, state], index) => {
      const to = place(index + 1 < runs.length ? runs[index + 1][0] : now);
      const x = place(from);
      const height = HEIGHTS[state] || HEIGHTS.unknown;
      if (to <= x) return;
      const size = { x, y: HEIGHT - height, width: to - x, height };
      strip.append(draw("rect", { "data-state": state, ...size }));
    });
    const marks = incidents.map((each) => {
      const text = `${name}: ${plain(each.kind)}, ${clock(each.from)}`;
      const mark = make("button", { type: "button", class: "mark", title: text, "aria-label": text });
      mark.style.left = `${(place(each.from) / WIDTH) * 100}%`;
      mark.addEventListener("click", () => this.asked(each.key));
      return mark;
    });
    return make("li", {}, make("span", {}, name), make("div", {}, strip, ...marks));
  }
}

function axis(since, now) {
  const labels = Array.from({ length: LABELS }, (_, at) => {
    const time = since + ((now - since) * at) / (LABELS - 1);
    return make("span", {}, clock(time));
  });
  return make("li", { class: "axis", "aria-hidden": "true" }, make("span"), make("div", {}, ...labels));
}

function spoken(name, runs, now) {
  const spent = new Map();
  runs.forEach(([from, state], index) => {
    const to = index + 1 < runs.length ? runs[index + 1][0] : now;
    spent.set(state, (spent.get(state) || 0) + to - from);
  });
  const parts = [...spent].map(([state, seconds]) => `${span(seconds)} ${word(state).toLowerCase()}`);
  return `${name}: ${parts.join(", ")}`;
}
