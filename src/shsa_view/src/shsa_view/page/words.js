// Numbers, times and states as people read them.

const STATES = {
  well: "Well",
  substituted: "Substituted",
  returning: "Returning",
  healing: "Healing",
  not_healed: "Not healed",
  kept: "Kept",
  failed: "Failed",
  starting: "Starting",
  unknown: "Not known",
  healed: "Substituted",
  unhealed: "Not healed",
  safe: "Safe value",
  ended: "Over",
};

export const MOMENTS = [
  ["last_good", "last good message"],
  ["detected", "failure seen"],
  ["killed", "faulty node gone"],
  ["found", "substitute found"],
  ["spawned", "substitute started"],
  ["first_message", "its first message"],
  ["returned", "original is back"],
  ["ended", "over"],
];

export const known = (number) => typeof number === "number" && Number.isFinite(number);

/** The word for a state. */
export function word(state) {
  return Object.hasOwn(STATES, state) ? STATES[state] : plain(state);
}

/** A word of files and messages, as a word. */
export const plain = (text) => String(text).replaceAll("_", " ");

/** A unit as it is written on paper. */
export function unit(text) {
  return text.replaceAll("**2", "²").replaceAll("**3", "³").replaceAll("*", "·");
}

/** A value with its expected error; the digits are those that the error leaves meaning to. */
export function measured(property) {
  const { value, error_p95: p95, error_rms: rms } = property;
  const error = known(p95) ? p95 : rms;
  const told = { error: plusMinus(p95, rms), unit: unit(property.unit) };
  if (!known(value)) return { ...told, value: "–" };
  const shown = known(error) ? value.toFixed(decimals(error)) : short(value);
  return { ...told, value: shown.replace("-", "−") };
}

/** An expected error: what 95 % of the errors are within, else their root mean square. */
export function plusMinus(p95, rms) {
  if (known(p95)) return `± ${short(p95, 2)}`;
  return known(rms) ? `± ${short(rms, 2)} rms` : "";
}

function decimals(error) {
  if (!(error > 0)) return 3;
  return Math.min(6, Math.max(0, 1 - Math.floor(Math.log10(error))));
}

/** A number in a few digits, without an exponent where that is shorter. */
export function short(number, digits = 4) {
  const magnitude = Math.abs(number);
  const extreme = number !== 0 && (magnitude < 1e-4 || magnitude >= 1e6);
  if (extreme) return number.toExponential(digits - 1);
  const rounded = Number(number.toPrecision(digits));
  if (digits > 2 || rounded === 0) return String(rounded);
  return magnitude < 1 ? number.toFixed(decimals(number)) : String(rounded);
}

/** A span of time: ms below a second, then s, then minutes. */
export function span(seconds) {
  const size = Math.abs(seconds);
  const sign = seconds < 0 ? "−" : "";
  if (size < 0.0095) return `${sign}${(size * 1000).toFixed(1)} ms`;
  if (size < 0.9995) return `${sign}${Math.round(size * 1000)} ms`;
  if (size < 59.95) return `${sign}${size.toFixed(size < 9.995 ? 2 : 1)} s`;
  const [big, small] = size < 3600 ? ["min", "s"] : ["h", "min"];
  const parts = Math.round(size / (size < 3600 ? 1 : 60));
  return `${sign}${Math.floor(parts / 60)} ${big} ${parts % 60} ${small}`;
}

const CLOCK = { hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23" };
const exact = new Intl.DateTimeFormat([], { ...CLOCK, fractionalSecondDigits: 3 });
const coarse = new Intl.DateTimeFormat([], CLOCK);
const date = new Intl.DateTimeFormat([], { dateStyle: "medium" });

/** The time of day, to the second. */
export const clock = (time) => coarse.format(time * 1000);

/** The time of day, to the millisecond. */
export const exactClock = (time) => exact.format(time * 1000);

/** The day, unless it is that of `now`. */
export function day(time, now) {
  const text = date.format(time * 1000);
  return text === date.format(now * 1000) ? "" : text;
}

/** Names in a row. */
export const list = (names, none = "nothing") => (names.length ? names.join(", ") : none);
