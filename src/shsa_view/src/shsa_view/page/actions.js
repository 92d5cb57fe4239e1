// What an operator may do: only where the server allows it, with a token in the page's address.
import { ask } from "./connection.js";
import { byId, make } from "./page.js";

const ACTIONS = [
  ["substitute", "Substitute now", (topic) => `Substitute ${topic} now? Its node may be ended, as after a failure.`],
  ["release", "Release", (topic) => `Release ${topic}? The original may publish again.`],
  ["inject", "Inject a fault", (topic, fault) => `Inject the fault "${fault}" into ${topic}? It harms the robot for a while.`],
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
    const faults = make("select", { "aria-label": "Fault" }, ...FAULTS.map((each) => make("option", {}, each)));
    const said = make("p", { role: "status" });
    const buttons = ACTIONS.map(([name, label, question]) => {
      const button = make("button", { type: "button", class: "acts", "data-action": name }, label);
      button.addEventListener("click", async () => {
        const body = { topic: service.topic, ...(name === "inject" ? { fault: faults.value } : {}) };
        if (await confirmed(question(service.topic, faults.value))) await act(name, body, said);
      });
      return button;
    });
    return place.replaceChildren(make("h3", {}, "Act"), make("div", { class: "buttons" }, ...buttons, faults), said);
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
    said.textContent = `${answer.success === false ? "Not done" : "Done"}: ${answer.detail || name}.`;
  } catch (error) {
    said.textContent = `Refused: ${error.message}`;
  }
}
