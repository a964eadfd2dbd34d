const FIRST_UTC_NS = 631152e12; // before 1990 a clock does not count from 1970, so that it gives no UTC
const PREFIX = { "N m": [1e3, "mN m"], "N m s/rad": [1e6, "µN m s/rad"] };

/** Factor and name of the unit in which a quantity is shown. */
export const shownIn = (unit) => PREFIX[unit] ?? [1, unit];

/** A number to three digits, SI prefix for torques. */
export function quantity(value, unit) {
  if (value === null || value === undefined) return "–";
  const [factor, shown] = shownIn(unit);
  return `${number(value * factor)} ${shown}`;
}

export function number(value) {
  return value === null || value === undefined ? "–" : String(Number(value.toPrecision(3)));
}

/** A value with its standard deviation, where that is known. */
export const withStd = (value, std, write = number) => `${write(value)}${std === null ? "" : ` ± ${write(std)}`}`;

/** Who did what an audit trail has, and the note. */
export const signed = (line) => `${line.person ? ` by ${line.person}` : ""}${line.note ? `: “${line.note}”` : ""}`;

export const SIGMAS = 1.96; // of a normal distribution: 95 %
export const byName = new Intl.Collator("en", { numeric: true }).compare;

/** A count with what is counted, in the singular or plural. */
export const counted = (count, what) => `${count} ${what}${count === 1 ? "" : "s"}`;

export const tellsUtc = (ns) => ns > FIRST_UTC_NS;

export function utc(ns) {
  return new Date(ns / 1e6).toISOString().replace("T", " ").slice(0, 19) + " UTC";
}

/** A wheel's time: UTC where its clock gives it, and the spacecraft clock beside. */
export function wheelTime(ns) {
  const clock = `spacecraft clock ${(ns / 1e9).toFixed(1)} s`;
  return tellsUtc(ns) ? `${utc(ns)} (${clock})` : `${clock}, UTC unknown`;
}

/** The same in short. */
export const shortTime = (ns) => (tellsUtc(ns) ? utc(ns) : `spacecraft clock ${(ns / 1e9).toFixed(1)} s`);

/** A length of time, in the largest unit of which there are some. */
export function span(s) {
  if (s < 120) return `${Math.floor(Math.max(0, s))} s`;
  if (s < 7200) return `${Math.floor(s / 60)} min`;
  if (s < 172800) return `${Math.floor(s / 3600)} h`;
  return `${Math.floor(s / 86400)} d`;
}

export const age = (ms) => `${span(ms / 1000)} ago`;

export function percent(share) {
  if (share > 0 && share < 0.001) return "< 0.1 %";
  if (share < 1 && share > 0.999) return "> 99.9 %";
  return `${Number((100 * share).toFixed(1))} %`;
}
