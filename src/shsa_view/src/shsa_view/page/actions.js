// What an operator may do: only where the server allows it, with a token in the page's address.
import { ask } from "./connection.js";
import { byId, make } from "./page.js";

const ACTIONS = [
  {
    name: "substitute",
    label: "Substitute now",
    question: (topic) => `Substitute ${topic} now? Its node may be ended, as after a failure.`,
  },
  {
    name: "release",
    label: "Release",
    question: (topic) => `Release ${topic}? The original may publish again.`,
  },
  {
    name: "inject",
    label: "Inject a fault",
    question: (topic, fault) =>
      `Inject the fault "${fault}" into ${topic}? It harms the robot for a while.`,
  },
];
const FAULTS = ["crash", "off", "hang", "stuck", "garbage", "wrong", "slow", "delayed", "nan"];
const LIMIT_MS = 20000;

/** The token, from the page's address. */
export function token() {
  return new URLSearchParams(location.hash.slice(1)).get("token");
}

export class Actions {
  constructor() {
    this.allowed = false;
  }

  offer(service) {
    const place = byId("actions");
    place.hidden = !(this.allowed && token() && service);
    if (place.hidden) return place.replaceChildren();
    const options = FAULTS.map((each) => make("option", {}, each));
    const faults = make("select", { "aria-label": "Fault" }, ...options);
    const said = make("p", { role: "status" });
    const buttons = ACTIONS.map(({ name, label, question }) => {
      const button = make("button", { type: "button", class: "acts", "data-action": name }, label);
      button.addEventListener("click", async () => {
        const { topic } = service;
        const body = name === "inject" ? { topic, fault: faults.value } : { topic };
        if (await confirmed(question(topic, faults.value))) await act(name, body, said);
      });
      return button;
    });
    const row = make("div", { class: "buttons" }, ...buttons, faults);
    return place.replaceChildren(make("h3", {}, "Act"), row, said);
  }
}

function confirmed(question) {
  const dialog = byId("confirm");
  byId("confirm-text").textContent = question;
  dialog.returnValue = "no";
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => resolve(dialog.returnValue === "yes"), { once: true });
  });
}

async function act(name, body, said) {
  said.textContent = "Asked …";
  try {
    const answer = await ask(`api/actions/${name}`, {
      method: "POST",
      body: JSON.stringify(body),
      headers: { Authorization: `Bearer ${token()}`, "Content-Type": "application/json" },
      limit: LIMIT_MS,
    });
    const done = answer.success === false ? "Not done" : "Done";
    said.textContent = `${done}: ${answer.detail || name}.`;
  } catch (error) {
    said.textContent = `Refused: ${error.message}`;
  }
}
