/** Each estimate of a wheel with its interval, above those of its siblings: the other wheels of the spacecraft. */
import { h } from "./dom.js";
import { SIGMAS, byName, quantity, shownIn } from "./format.js";
import { REPLAY, last } from "./store.js";
import { SIGN, colour } from "./verdict.js";

const MOST = 16; // wheels of a spacecraft that are compared
const QUANTITIES = [["base dry", "dry", (one) => one.friction.base_dry], ["viscous", "viscous", (one) => one.friction.viscous]];
const WIDE = 300, ROW = 22, MARGIN = 8;

export function estimatesBeside(store, wheel, base) {
  const place = h("div", { class: "two" });
  const element = h("section", { class: "card", hidden: true }, h("h2", {}, "Estimates with 95 % intervals, beside the siblings"), place,
    h("div", { class: "key" }, h("span", {}, "● estimate of each wheel's latest window, and its interval"), h("span", {}, "shaded: this wheel's nominal range"), h("span", {}, "without a line: no interval is known")));
  let drawn = "";

  function refresh() {
    const wheels = [wheel, ...[...store.wheels.values()].filter((one) => one !== wheel && !one.wheel.endsWith(REPLAY) && one.spacecraft === wheel.spacecraft && !store.isRetired(one.name)).sort((a, b) => byName(a.name, b.name))].filter((one) => last(one)).slice(0, MOST);
    const now = wheels.map((one) => `${one.name} ${last(one).window_end_ns} ${last(one).verdict}`).join();
    if (now === drawn) return;
    drawn = now;
    element.hidden = !wheels.includes(wheel);
    if (!element.hidden) place.replaceChildren(...QUANTITIES.map((one) => picture(wheels, ...one)).filter(Boolean));
  }

  function picture(wheels, title, part, of) {
    const rows = wheels.map((one) => ({ one, found: of(last(one)) })).filter(({ found }) => found.value !== null);
    if (!rows.length) return null;
    const [factor, unit] = shownIn(rows[0].found.unit);
    const nominal = last(wheel).anomalies[part] ?? { nominal_low: null, nominal_high: null };
    const half = ({ std }) => (std === null ? 0 : SIGMAS * std);
    const values = [...rows.flatMap(({ found }) => [found.value - half(found), found.value + half(found)]), nominal.nominal_low, nominal.nominal_high].filter((one) => one !== null);
    const low = Math.min(...values), high = Math.max(...values);
    const x = (value) => MARGIN + ((value - low) / (high - low || 1)) * (WIDE - 2 * MARGIN);
    return h("div", {}, h("h3", {}, `${title} [${unit}]`), h("div", { class: "beside" }, rows.flatMap(({ one, found }) => {
      const diagnosis = last(one);
      const text = withHalf(found.value * factor, half(found) * factor);
      const line = svg("svg", { viewBox: `0 0 ${WIDE} ${ROW}`, preserveAspectRatio: "none", "aria-hidden": "true", class: colour(diagnosis) },
        nominal.nominal_low === null ? null : svg("rect", { class: "range", x: x(nominal.nominal_low), width: Math.max(1, x(nominal.nominal_high) - x(nominal.nominal_low)), y: 0, height: ROW }),
        svg("line", { x1: x(found.value - half(found)), x2: x(found.value + half(found)), y1: ROW / 2, y2: ROW / 2 }),
        svg("line", { class: "dot", x1: x(found.value), x2: x(found.value), y1: ROW / 2, y2: ROW / 2 }));
      const name = one === wheel ? h("b", {}, `${one.wheel} (this)`) : h("a", { href: `${base}/wheel/${one.name}` }, one.wheel);
      return [h("span", {}, h("span", { class: colour(diagnosis), title: diagnosis.verdict }, SIGN[diagnosis.verdict]), " ", name), line, h("span", { class: "figure" }, text)];
    })), nominal.nominal_low === null ? null : h("p", { class: "soft" }, `nominal ${quantity(nominal.nominal_low, rows[0].found.unit)} to ${quantity(nominal.nominal_high, rows[0].found.unit)}`));
  }
  return { element, refresh };
}

/** A value and the half of its interval, both to the interval's second digit. */
function withHalf(value, half) {
  if (!half) return String(Number(value.toPrecision(4)));
  const digits = Math.min(9, Math.max(0, 1 - Math.floor(Math.log10(half))));
  return `${value.toFixed(digits)} ± ${half.toFixed(digits)}`;
}

function svg(tag, attributes, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children.filter(Boolean));
  return element;
}
