export const SIGN = { nominal: "✓", anomalous: "▲", inconclusive: "?" };
const EPOCH_NS = 6e17; // before 1989 a clock does not count from 1970, so that it tells no UTC

/** A number to three digits, SI prefix for torques. */
export function quantity(value, unit) {
  if (value === null || value === undefined) return "–";
  if (unit === "N m") return `${number(value * 1e3)} mN m`;
  if (unit === "N m s/rad") return `${number(value * 1e6)} µN m s/rad`;
  return `${number(value)} ${unit}`;
}

export function number(value) {
  return value === null || value === undefined ? "–" : String(Number(value.toPrecision(3)));
}

export function utc(ns) {
  return new Date(ns / 1e6).toISOString().replace("T", " ").slice(0, 19) + " UTC";
}

/** A wheel's time: UTC where its clock tells it, and the spacecraft clock beside. */
export function wheelTime(ns) {
  const clock = `spacecraft clock ${(ns / 1e9).toFixed(1)} s`;
  return ns > EPOCH_NS ? `${utc(ns)} (${clock})` : `${clock}, UTC unknown`;
}

export function age(ms) {
  const s = Math.max(0, ms / 1000);
  if (s < 60) return `${Math.floor(s)} s ago`;
  if (s < 3600) return `${Math.floor(s / 60)} min ago`;
  if (s < 172800) return `${Math.floor(s / 3600)} h ago`;
  return `${Math.floor(s / 86400)} d ago`;
}

export function percent(share) {
  return `${(100 * share).toFixed(share > 0.001 && share < 0.999 ? 1 : 0)} %`;
}
