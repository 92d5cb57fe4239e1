// The strip of the last minute: one letter a second. The worse a second was, the taller its bar.
import { draw, setAttribute } from "./page.js";

const SECONDS = 60;
const LETTERS = {
  w: { state: "well", height: 4, says: "well" },
  s: { state: "substituted", height: 8, says: "substituted" },
  h: { state: "healing", height: 11, says: "healing" },
  f: { state: "failed", height: 14, says: "not healed" },
  u: { state: "unknown", height: 2, says: "not known" },
};

export class Strip {
  constructor() {
    this.paths = {};
    this.element = draw("svg", {
      class: "strip",
      role: "img",
      viewBox: `0 0 ${SECONDS} 14`,
      preserveAspectRatio: "none",
    });
    for (const [letter, { state }] of Object.entries(LETTERS)) {
      this.paths[letter] = draw("path", { "data-state": state });
      this.element.append(this.paths[letter]);
    }
    this.letters = null;
  }

  show(letters) {
    const last = (letters || "").slice(-SECONDS);
    if (last === this.letters) return;
    this.letters = last;
    const counted = {};
    const drawn = {};
    for (const [letter, from, length] of runs(last)) {
      counted[letter] = (counted[letter] || 0) + length;
      const x = SECONDS - last.length + from;
      const top = 14 - LETTERS[letter].height;
      drawn[letter] = `${drawn[letter] || ""}M${x} 14V${top}h${length}V14z`;
    }
    for (const letter of Object.keys(LETTERS)) {
      setAttribute(this.paths[letter], "d", drawn[letter] || null);
    }
    setAttribute(this.element, "aria-label", spoken(counted));
  }
}

function* runs(letters) {
  let from = 0;
  for (let index = 1; index <= letters.length; index += 1) {
    if (letters[index] === letters[from]) continue;
    yield [Object.hasOwn(LETTERS, letters[from]) ? letters[from] : "u", from, index - from];
    from = index;
  }
}

function spoken(counted) {
  const parts = Object.entries(LETTERS)
    .filter(([letter]) => counted[letter])
    .map(([letter, { says }]) => `${counted[letter]} s ${says}`);
  return parts.length ? `Last minute: ${parts.join(", ")}` : "Last minute: not known";
}
