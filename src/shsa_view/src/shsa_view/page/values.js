// Values over time: a chart for each property of a service, drawn by uPlot.
import uPlot from "./uplot/uPlot.esm.js";
import { ask } from "./connection.js";
import { byId, make } from "./page.js";
import { clock, known, plain, short, unit } from "./words.js";

const EVERY_MS = 1000;
const HEIGHT = 170;
const DOTTED = [2, 4];
const DASHED = [6, 4];
const MOMENTS = { detected: "--failed", first_message: "--substituted", returned: "--well" };

export class Values {
  constructor() {
    this.place = byId("values");
    this.charts = new Map();
    this.asked = 0;
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.dark.addEventListener("change", () => this.clear());
  }

  /** Shows the newest values of a service, or those around an incident. */
  open(name, robot, incident = null) {
    this.close();
    this.name = name;
    this.robot = robot;
    this.incident = incident;
    this.timer = setInterval(() => this.look(), EVERY_MS);
    return this.look();
  }

  close() {
    clearInterval(this.timer);
    this.asked += 1;
    this.name = null;
    this.clear();
  }

  clear() {
    for (const { plot } of this.charts.values()) plot.destroy();
    this.charts.clear();
    this.place.replaceChildren();
  }

  async look() {
    this.asked += 1;
    const { asked, name, incident } = this;
    const key = incident ? `&incident=${encodeURIComponent(incident.key)}` : "";
    try {
      const told = await ask(`api/values?service=${encodeURIComponent(name)}${key}`);
      if (asked === this.asked) this.show(told);
    } catch (error) {
      if (asked === this.asked) this.said(error.message);
    }
  }

  said(text) {
    this.clear();
    this.place.append(make("p", { class: "quiet" }, text));
  }

  show(told) {
    const service = this.robot.services[this.name];
    if (told.incident) clearInterval(this.timer);
    if (this.incident && !told.incident) this.place.dataset.newest = "";
    else delete this.place.dataset.newest;
    const named = Object.entries(told.properties);
    const heard = ([, each]) => each.values.some(known);
    if (!service || !named.some(heard)) {
      this.said("No value was seen yet.");
      return;
    }
    if (this.place.firstChild && !this.charts.size) this.place.replaceChildren();
    for (const [property, each] of named) {
      const shape = service.properties[property] || { unit: "", range: null };
      this.draw(property, each, shape, told);
    }
  }

  draw(property, each, shape, told) {
    const columns = [
      ...[bound(each, 1), bound(each, -1)],
      ...[of(each, told, false), of(each, told, true)],
      ...(shape.range || []).map((limit) => each.values.map(() => limit)),
      ...Object.values(each.witnesses),
    ];
    const witnesses = Object.keys(each.witnesses);
    const signature = JSON.stringify([witnesses, shape.range]);
    let chart = this.charts.get(property);
    if (chart && chart.signature !== signature) {
      this.clear();
      chart = null;
    }
    if (!chart) {
      chart = { signature, plot: this.plot(property, shape, witnesses) };
      this.charts.set(property, chart);
    }
    chart.plot.setData([told.times, ...columns]);
  }

  plot(property, shape, witnesses) {
    const color = (name) => getComputedStyle(this.place).getPropertyValue(name).trim();
    const told = (_, value) => (known(value) ? short(value) : "–");
    const line = (label, stroke, more = {}) => ({ label, stroke, value: told, ...more });
    const thin = { width: 1, points: { show: false } };
    const limits = (shape.range || []).map((_, at) =>
      line(at ? "highest" : "lowest", color("--failed"), { ...thin, dash: DASHED }),
    );
    const said = witnesses.map((name) =>
      line(`by ${name}`, color("--healing"), { ...thin, dash: DOTTED }),
    );
    const axis = { stroke: color("--quiet"), grid: { stroke: color("--faint") }, font: "12px sans-serif" };
    const title = `${plain(property)}${shape.unit ? `, ${unit(shape.unit)}` : ""}`;
    const figure = make("figure", { "data-property": property }, make("figcaption", {}, title));
    this.place.append(figure);
    const options = {
      width: Math.max(240, figure.clientWidth),
      height: HEIGHT,
      legend: { live: true },
      cursor: { sync: { key: "values" } },
      series: [
        { value: (_, value) => (known(value) ? clock(value) : "–") },
        line("+ error", "transparent", thin),
        line("− error", "transparent", thin),
        line("sensor", color("--well"), { width: 2 }),
        line("substitute", color("--substituted"), { width: 2 }),
        ...limits,
        ...said,
      ],
      bands: [{ series: [1, 2], fill: color("--unknown-soft") }],
      scales: { y: { range: (_, low, high) => this.range(low, high) } },
      axes: [{ ...axis, values: (_, splits) => splits.map(clock), space: 80 }, { ...axis, size: 60 }],
      hooks: { draw: [(plot) => this.marks(plot, color)] },
    };
    return new uPlot(options, [[], ...options.series.slice(1).map(() => [])], figure);
  }

  range(low, high) {
    if (!known(low) || !known(high)) return [0, 1];
    const room = high > low ? (high - low) * 0.08 : Math.abs(high) * 0.1 || 1;
    return [low - room, high + room];
  }

  /** The moments of its incidents: seen, taken over, back. */
  marks(plot, color) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.lineWidth = devicePixelRatio;
    for (const incident of this.robot.incidents.filter((each) => each.service === this.name)) {
      for (const [name, ink] of Object.entries(MOMENTS)) {
        const moment = incident.moments[name];
        if (!known(moment)) continue;
        const x = plot.valToPos(moment, "x", true);
        if (x < bbox.left || x > bbox.left + bbox.width) continue;
        ctx.strokeStyle = color(ink);
        ctx.beginPath();
        ctx.moveTo(x, bbox.top);
        ctx.lineTo(x, bbox.top + bbox.height);
        ctx.stroke();
      }
    }
    ctx.restore();
  }
}

/** The values of the sensor or of its substitute. */
function of(each, told, substituted) {
  return each.values.map((value, at) => (told.substituted[at] === substituted ? value : null));
}

/** The values with their error added or taken away. */
function bound(each, sign) {
  return each.values.map((value, at) =>
    known(value) && known(each.errors[at]) ? value + sign * each.errors[at] : null,
  );
}
