// Elements of the page, made and changed. Text is text: nothing here reads markup.

const SVG = "http://www.w3.org/2000/svg";

export const byId = (id) => document.getElementById(id);

/** An element with attributes (those that are null are left out) and children: elements or text. */
export function make(tag, attributes = {}, ...children) {
  return filled(document.createElement(tag), attributes, children);
}

/** The same of SVG. */
export function draw(tag, attributes = {}, ...children) {
  return filled(document.createElementNS(SVG, tag), attributes, children);
}

function filled(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== null) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/** Changes a text if it is another one: what stays the same costs no layout. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** The same for a name, which may be broken after a slash or an underscore. */
export function setName(element, name) {
  if (element.textContent === name) return;
  const parts = name.split(/(?<=[^/_][/_])(?=[^/_])/);
  element.replaceChildren(...parts.flatMap((part, at) => (at ? [make("wbr"), part] : [part])));
}

/** What is told of something, each under its term; a row without a text is left out. */
export function facts(pairs) {
  const told = pairs.filter(([, text]) => text);
  const row = ([term, text]) => make("div", {}, make("dt", {}, term), make("dd", {}, text));
  return make("dl", {}, ...told.map(row));
}

/** The same for an attribute; null takes it away. */
export function setAttribute(element, name, value) {
  if (value === null) element.removeAttribute(name);
  else if (element.getAttribute(name) !== value) element.setAttribute(name, value);
}

const SHAPES = {
  well: "well",
  substituted: "substituted",
  returning: "substituted",
  healed: "substituted",
  healing: "healing",
  kept: "kept",
  safe: "kept",
  failed: "failed",
  not_healed: "failed",
  unhealed: "failed",
  ended: "ended",
};

/** The shape that stands for a state, beside its word. */
export function shape(state) {
  const use = draw("use", { href: reference(state) });
  return draw("svg", { class: "shape", "data-state": state, "aria-hidden": "true" }, use);
}

/** Changes a shape to that of another state. */
export function setShape(element, state) {
  setAttribute(element, "data-state", state);
  setAttribute(element.firstChild, "href", reference(state));
}

function reference(state) {
  return `#shape-${Object.hasOwn(SHAPES, state) ? SHAPES[state] : "unknown"}`;
}

/** One stop of the Tab key for many elements: the arrow keys go on, as `next(from, key)` says. */
export function roving(container, selector, next) {
  container.addEventListener("focusin", (event) => {
    const stop = event.target.closest(selector);
    if (stop) makeStop(container, selector, stop);
  });
  container.addEventListener("keydown", (event) => {
    const from = event.target.closest(selector);
    if (!from || !event.key.startsWith("Arrow") || event.altKey || event.ctrlKey) return;
    const to = next(from, event.key);
    if (!to) return;
    event.preventDefault();
    to.focus();
  });
}

/** Says which element the Tab key reaches. */
export function makeStop(container, selector, stop) {
  for (const other of container.querySelectorAll(`${selector}[tabindex="0"]`)) {
    if (other !== stop) other.setAttribute("tabindex", "-1");
  }
  if (stop) stop.setAttribute("tabindex", "0");
}
