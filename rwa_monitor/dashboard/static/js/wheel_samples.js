/** What one wheel's samples show: speed, friction with its jumps, what the model leaves. */
import { COLOURS, GREY, chart, marks, systemStyle } from "./charts.js";
import { h, keyEntry } from "./dom.js";
import { dryFriction, simulated } from "./friction.js";
import { last } from "./store.js";

const MAX_DRAWN = 3000;
const CLOUD = "rgba(133,147,160,.55)";

export function wheelSamples(store, wheel) {
  const sync = `samples of ${wheel.name} ${store.live}`;
  const key = h("div", { class: "key" });
  const notice = h("p", { class: "soft" });
  const speed = chart({ label: "speed", unit: "rad/s", height: 170, sync, series: [{ label: "speed", colour: COLOURS[1] }] });
  const friction = chart({ label: "friction", unit: "mN m", height: 270, sync, draw: (u) => marks(u, jumps()), series: [{ label: "measured", colour: CLOUD, width: 0, points: true }, { label: "simulated", colour: COLOURS[0], width: 2 }] });
  const residual = chart({ label: "residual", unit: "mN m", height: 170, sync, series: [{ label: "measured less simulated", colour: COLOURS[3], width: 0, points: true }] });
  const charts = [speed, friction, residual];
  let systems = [];

  function jumps() {
    return [
      ...wheel.diagnoses.flatMap((one) => one.changepoints.map((jump) => ({ x: jump.time_ns / 1e9, ...systemStyle(jump.fss, systems) }))),
      ...wheel.jumps.map((jump) => ({ x: jump.time_ns / 1e9, colour: GREY, shape: "◇" })),
    ];
  }

  function refresh(fss) {
    systems = fss;
    const step = Math.max(1, Math.ceil(wheel.t.length / MAX_DRAWN));
    const times = [], speeds = [], measured = [], model = [], rest = [];
    for (let i = 0; i < wheel.t.length; i += step) {
      const torque = wheel.friction[i], omega = wheel.speed[i];
      const against = torque === null || omega === null ? null : torque * Math.sign(omega);
      const expected = omega === null ? null : simulated(wheel.diagnoses, wheel.t[i] * 1e9, omega);
      times.push(wheel.t[i]);
      speeds.push(omega);
      measured.push(against === null ? null : against * 1e3);
      model.push(expected === null ? null : expected * 1e3);
      rest.push(against === null || expected === null ? null : (against - expected) * 1e3);
    }
    const window = last(wheel);
    const unseen = !times.length && window?.friction.base_dry.value != null && window.friction.viscous.value !== null;
    if (unseen) {
      const [at, dry] = dryFriction(window);
      times.push(...at);
      model.push(...dry.map((value) => value * 1e3));
      for (const list of [speeds, measured, rest]) list.push(...at.map(() => null));
    }
    notice.textContent = unseen
      ? "No samples of this window are kept. The line is the dry friction that its diagnosis estimated, base and switching systems, with its jumps."
      : !times.length ? "No samples now: they are drawn while they come over the bus. Earlier ones are under Recordings."
      : measured.every((value) => value === null) ? "These samples hold no friction torque, and none can be derived: that takes motor current or torque and the wheel's inertia (--wheel)." : "";
    drawing.hidden = !times.length;
    if (drawing.hidden) return;
    speed.element.hidden = left.hidden = unseen;
    friction.set([times, measured, model]);
    if (!unseen) {
      speed.set([times, speeds]);
      residual.set([times, rest]);
    }
    key.replaceChildren(h("span", {}, "· measured, positive against the rotation"), h("span", {}, "— simulated from the diagnosis"), ...systems.map((one) => legend(one, one)), legend("", "not (yet) attributed"), legend("rejected", "rejected"));
  }

  function legend(system, text) {
    const { colour, shape } = systemStyle(system, systems);
    return keyEntry(shape, colour, text);
  }

  const left = h("div", {}, h("h2", {}, "Measured less simulated"), residual.element, h("p", { class: "soft" }, "Simulated: base dry and viscous friction and the switching systems. Jumps that fit no system stay in the residual."));
  const drawing = h("div", {}, speed.element, friction.element, key, left);
  const element = h("section", { class: "card" }, h("h2", {}, "Speed, friction and jumps"), notice, drawing);
  return { element, refresh, get width() { return friction.width; }, close: () => charts.forEach((one) => one.close()) };
}
