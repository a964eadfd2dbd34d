/** One wheel over weeks: the friction's parts stacked, and each estimate with its nominal range and alarm limits. */
import { COLOURS, GREY, chart, systemStyle } from "./charts.js";
import { h, keyEntry } from "./dom.js";
import { number, quantity, shownIn, span } from "./format.js";
import { meanFriction } from "./friction.js";

const REFERENCE_SPEED = 300; // rad/s: the speed at which viscous friction is compared with dry
// Severities at which a window reaches a level, as `history.alarms.Policy` has them; a watch begins at the nominal bound.
const LIMITS = [["warning", 0.5, COLOURS[4], [2, 4]], ["distress", 1.5, COLOURS[0], [6, 4]], ["critical", 3, COLOURS[3], [12, 4]]];
const NOMINAL = "rgba(0, 158, 115, .18)";

/** Friction split, window by window; stacked: drawn from the whole to the first part, each over the one before. */
export function frictionSplit(wheel) {
  const place = h("div", {});
  let stack = null;
  let shown = "";

  function refresh(systems) {
    const parts = ["base dry", `viscous at ${REFERENCE_SPEED} rad/s`, ...systems];
    if (shown !== parts.join()) make(parts, systems);
    const rows = wheel.diagnoses.map((one) => {
      let sum = 0;
      const friction = one.friction;
      return [(friction.base_dry.value ?? 0) * 1e3, (friction.viscous.value ?? 0) * REFERENCE_SPEED * 1e3, ...systems.map((system) => (friction.fss[system] ? meanFriction(friction.fss[system], one.samples) * 1e3 : 0))].map((part) => (sum += part));
    });
    stack.set([wheel.diagnoses.map((one) => one.window_end_ns / 1e9), ...parts.map((_, i) => rows.map((row) => row[i])).reverse()]);
  }

  function make(parts, systems) {
    shown = parts.join();
    stack?.close();
    const colours = [GREY, COLOURS[5], ...systems.map((one) => systemStyle(one, systems).colour)];
    const bars = uPlot.paths.bars({ size: [0.8, 60] });
    stack = chart({ label: "friction", unit: "mN m", zero: true, series: parts.map((part, i) => ({ label: `up to ${part}`, colour: colours[i], fill: colours[i], width: 1, paths: bars })).reverse() });
    place.replaceChildren(stack.element, h("div", { class: "key" }, "from below: ", parts.map((part, i) => keyEntry("█", colours[i], `${i + 1}. ${part}`))));
  }
  return { element: place, refresh, close: () => stack?.close() };
}

/** Each estimate over time, from the records of the history; `trends` as the API gives them. */
export function estimateTrends() {
  const place = h("div", { class: "two" });
  let lines = [];

  /** `parts` give the order. */
  function refresh(records, trends, parts) {
    const names = parts.filter((part) => records.some((one) => one.name === part));
    if (lines.map(({ name }) => name).join() !== names.join()) make(names, records);
    for (const { name, one, trend } of lines) {
      const own = records.filter((record) => record.name === name);
      const [factor] = shownIn(own[0].unit);
      const at = (value) => (value === null || value === undefined ? null : value * factor);
      const values = own.map((record) => at(record.value));
      const limits = limitsOf(own);
      one.set([own.map((record) => record.window_end_ns / 1e9), values, values.map((value, i) => (own[i].active ? value : null)), own.map((record) => at(record.nominal_high)), own.map((record) => at(record.nominal_low)), ...LIMITS.map((_, n) => limits.map((row) => at(row?.[n])))]);
      trend.textContent = trendText(trends?.[name], own[0].unit);
    }
  }

  function make(names, records) {
    lines.forEach(({ one }) => one.close());
    lines = names.map((name) => {
      const [, unit] = shownIn(records.find((record) => record.name === name).unit);
      const one = chart({
        label: name, unit, height: 200, bands: [[3, 4, NOMINAL]],
        series: [{ label: "estimate", colour: COLOURS[1], points: true, size: 7 }, { label: "anomalous", colour: COLOURS[0], width: 0, points: true, size: 12 }, { label: "nominal up to", colour: COLOURS[2], width: 1, steps: true }, { label: "nominal from", colour: COLOURS[2], width: 1, steps: true }, ...LIMITS.map(([level, , colour, dash]) => ({ label: level, colour, dash, width: 1.5, steps: true }))],
      });
      return { name, one, trend: h("p", { class: "soft" }) };
    });
    place.replaceChildren(...lines.map(({ one, trend }) => h("div", {}, one.element, trend)));
  }

  const key = h("div", { class: "key" }, "Shaded: nominal. Large points: anomalous, more likely than not. Limits: ", LIMITS.map(([level, severity, colour, dash]) => keyEntry(dash[0] < 4 ? "┈┈" : dash[0] < 10 ? "╌╌" : "──", colour, `${level}, severity ${severity}`)));
  return { element: h("div", {}, key, place), refresh, close: () => lines.forEach(({ one }) => one.close()) };
}

/** Values at which each window would have reached each level. A severity s is the nominal bound plus s steps; how long a
 *  step is shows in every window with a severity above 0, and holds for those with the same nominal bound. */
function limitsOf(records) {
  const steps = new Map();
  for (const one of records) if (one.severity > 0 && one.value !== null) steps.set(one.nominal_high, (one.value - one.nominal_high) / one.severity);
  return records.map(({ nominal_high: bound }) => (steps.has(bound) ? LIMITS.map(([, severity]) => bound + severity * steps.get(bound)) : null));
}

function trendText(trend, unit) {
  if (!trend) return "";
  const test = `p = ${number(trend.p_value)}, ${trend.windows} windows`;
  if (!trend.present) return `→ No trend (${test}).`;
  const way = trend.slope_per_day > 0 ? "↑ Grows" : "↓ Falls";
  return `${way} by ${quantity(Math.abs(trend.slope_per_day), unit)} ± ${quantity(trend.slope_std_per_day, unit)} a day (${test})${reachText(trend.reach, unit)}.`;
}

function reachText(reach, unit) {
  if (!reach) return "";
  const time = (s) => (s === null ? "never" : span(s));
  return `; reaches ${quantity(reach.limit, unit)} (${reach.level}) in ${time(reach.median_s)}, 95 %: ${time(reach.low_s)} to ${time(reach.high_s)}`;
}
