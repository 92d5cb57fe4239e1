// The stream of events, opened again whenever it ends. A silent server is asked whether it lives.

const SILENCE_MS = 6000;
const ANSWER_MS = 4000;
const RETRIES_MS = [250, 500, 1000, 2000];

export class Connection {
  /** `heard(whole)`: the state, at first and after each break; `changed(changes)`; `lost()`. */
  constructor(handlers) {
    this.handlers = handlers;
    this.connected = false;
    this.attempts = 0;
    this.source = null;
    this.asking = false;
    this.heardAt = performance.now();
    setInterval(() => this.look(), 1000);
    this.open();
  }

  open() {
    const source = new EventSource("api/events");
    this.source = source;
    this.heardAt = performance.now();
    source.addEventListener("state", (event) => this.whole(JSON.parse(event.data)));
    source.addEventListener("change", (event) => {
      this.heardAt = performance.now();
      if (this.connected) this.handlers.changed(JSON.parse(event.data));
    });
    source.onerror = () => this.broken(source);
  }

  whole(robot) {
    this.heardAt = performance.now();
    this.attempts = 0;
    this.connected = true;
    this.handlers.heard(robot);
  }

  broken(source) {
    if (source !== this.source) return;
    source.close();
    this.source = null;
    this.connected = false;
    this.handlers.lost();
    const wait = RETRIES_MS[Math.min(this.attempts, RETRIES_MS.length - 1)];
    this.attempts += 1;
    setTimeout(() => this.open(), wait);
  }

  /** A robot may be silent, and so may a server that hangs: its state tells them apart. */
  async look() {
    if (!this.source || this.asking || performance.now() - this.heardAt < SILENCE_MS) return;
    const source = this.source;
    this.asking = true;
    try {
      const answer = await ask("api/state");
      if (source === this.source && this.connected) this.whole(answer);
      else this.broken(source);
    } catch (error) {
      this.broken(source);
    } finally {
      this.asking = false;
    }
  }
}

/** A JSON document of the server. Throws an Error that says what went wrong. */
export async function ask(address, options = {}) {
  const control = new AbortController();
  const timer = setTimeout(() => control.abort(), options.limit || ANSWER_MS);
  let answer;
  try {
    answer = await fetch(address, { cache: "no-store", ...options, signal: control.signal });
    const body = await answer.json().catch(() => ({}));
    if (answer.ok) return body;
    throw new Error(body.error || `The server answers with ${answer.status}.`);
  } catch (error) {
    if (control.signal.aborted) throw new Error("The server does not answer.");
    throw answer ? error : new Error("The server cannot be reached.");
  } finally {
    clearTimeout(timer);
  }
}
