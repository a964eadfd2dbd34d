/** Friction of the latest window over speed and over temperature, beside the fitted law: what is no straight line shows. */
import { COLOURS, chart } from "./charts.js";
import { h } from "./dom.js";
import { simulated } from "./friction.js";
import { SIGMAS, number } from "./format.js";
import { last } from "./store.js";

const MAX_DRAWN = 3000;
const CLOUD = "rgba(133,147,160,.55)";
const BAND = "rgba(213, 94, 0, .22)";
const LEAST_KELVIN = 0.5; // of temperature in a window, below which a slope over it would be noise

export function frictionLaws(wheel) {
  const law = [{ label: "law", colour: COLOURS[0], width: 2 }, { label: "law, 95 % up to", colour: COLOURS[0], width: 0 }, { label: "law, 95 % from", colour: COLOURS[0], width: 0 }];
  const measured = (label) => ({ label, colour: CLOUD, width: 0, points: true });
  const speed = chart({ label: "friction", unit: "mN m", height: 260, zero: true, over: { label: "speed", unit: "rad/s" }, series: [measured("measured less switching"), ...law], bands: [[3, 4, BAND]] });
  const warmth = chart({ label: "friction", unit: "mN m", height: 260, over: { label: "bearing temperature", unit: "°C" }, series: [measured("at one speed"), { label: "law", colour: COLOURS[0], width: 2 }, { label: "straight line", colour: COLOURS[1], width: 2, dash: [6, 4] }] });
  const slope = h("p", { class: "soft" });
  const right = h("div", {}, warmth.element);
  const line = h("span", {}, "╌╌ least squares over temperature");
  const beside = h("div", {}, h("div", {}, speed.element), h("div", {}, right, slope));
  const element = h("section", { class: "card", hidden: true }, h("h2", {}, "Friction over speed and temperature, latest window"),
    beside,
    h("div", { class: "key" }, h("span", {}, "· measured, less the switching systems, positive against the rotation"), h("span", {}, "— base dry + viscous × speed, as diagnosed; shaded: its 95 % interval"), line));

  function refresh() {
    const window = last(wheel);
    const samples = window ? ofWindow(wheel, window) : [];
    element.hidden = samples.length < 2;
    if (element.hidden) return;
    const warm = samples.filter((one) => one.temperature !== null);
    beside.className = warm.length < 2 ? "" : "two"; // before the charts measure how wide they are
    const { base_dry: dry, viscous } = window.friction;
    const at = (speed) => dry.value + viscous.value * Math.abs(speed);
    const half = (speed) => SIGMAS * Math.hypot(dry.std ?? 0, (viscous.std ?? 0) * speed); // the two as if independent
    samples.sort((a, b) => a.speed - b.speed);
    const speeds = samples.map((one) => one.speed);
    const torque = (value) => value * 1e3;
    speed.set([speeds, samples.map((one) => torque(at(one.speed) + one.rest)), speeds.map((one) => torque(at(one))), speeds.map((one) => torque(at(one) + half(one))), speeds.map((one) => torque(at(one) - half(one)))]);
    drawWarmth(warm, at, torque);
  }

  /** Friction brought to the median speed by the law, so that only what it leaves depends on temperature. */
  function drawWarmth(samples, at, torque) {
    right.hidden = line.hidden = samples.length < 2;
    if (right.hidden) {
      slope.textContent = "No bearing temperature is measured on this wheel: how friction depends on it cannot be shown.";
      return;
    }
    const middle = samples.map((one) => Math.abs(one.speed)).sort((a, b) => a - b)[samples.length >> 1];
    samples.sort((a, b) => a.temperature - b.temperature);
    const x = samples.map((one) => one.temperature), y = samples.map((one) => torque(at(middle) + one.rest));
    const fit = straight(x, y);
    warmth.set([x, y, x.map(() => torque(at(middle))), x.map((one) => fit?.(one) ?? null)]);
    slope.textContent = `Brought to ${number(middle)} rad/s by the law, which has no temperature in it. ${fit ? `Over ${number(x[0])} to ${number(x[x.length - 1])} °C friction changes by ${number(fit.slope)} mN m per K.` : `The temperature spans less than ${LEAST_KELVIN} K: too little for a slope.`}`;
  }
  return { element, refresh, close: () => { speed.close(); warmth.close(); } };
}

/** The samples of a window that have speed and friction, thinned: speed, temperature, what the diagnosis leaves [N m]. */
function ofWindow(wheel, window) {
  const found = [];
  const within = wheel.t.filter((t) => t * 1e9 >= window.window_start_ns && t * 1e9 < window.window_end_ns).length;
  const step = Math.max(1, Math.ceil(within / MAX_DRAWN));
  for (let i = 0; i < wheel.t.length; i += step) {
    const speed = wheel.speed[i], torque = wheel.friction[i];
    const expected = torque === null || speed === null ? null : simulated([window], wheel.t[i] * 1e9, speed);
    if (expected !== null) found.push({ speed, temperature: wheel.temperature[i], rest: torque * Math.sign(speed) - expected });
  }
  return found;
}

/** The straight line of least squares through points whose x is sorted, with its slope; null where x spans too little. */
function straight(x, y) {
  if (x[x.length - 1] - x[0] < LEAST_KELVIN) return null;
  const mean = (list) => list.reduce((sum, one) => sum + one, 0) / list.length;
  const mx = mean(x), my = mean(y);
  const slope = x.reduce((sum, one, i) => sum + (one - mx) * (y[i] - my), 0) / x.reduce((sum, one) => sum + (one - mx) ** 2, 0);
  return Object.assign((at) => my + slope * (at - mx), { slope });
}
