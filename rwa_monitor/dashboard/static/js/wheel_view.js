import { COLOURS, GREY, band, chart, marks, systemStyle } from "./charts.js";
import { h } from "./dom.js";
import { SIGN, age, number, percent, quantity, wheelTime } from "./format.js";
import { meanFriction, simulated } from "./friction.js";
import { last } from "./store.js";

const REFERENCE_SPEED = 300; // rad/s: the speed at which viscous friction is compared with dry
const SCALE = { "N m": [1e3, "mN m"], "N m s/rad": [1e6, "µN m s/rad"] };
const MAX_DRAWN = 3000;

/** One wheel: what is wrong and why, the friction and its parts, the quality of the data. */
export function wheelView(store, name, base) {
  const wheel = store.wheel(name);
  const head = h("section", { class: "card" });
  const table = h("div", { class: "scroll" });
  const quality = h("dl", {});
  const key = h("div", { class: "key" });
  let systems = [];
  let drawn = "";
  const jumps = (u) => marks(u, [
    ...wheel.diagnoses.flatMap((one) => one.changepoints.filter((jump) => jump.fss !== "rejected").map((jump) => ({ x: jump.time_ns / 1e9, ...systemStyle(jump.fss, systems) }))),
    ...wheel.jumps.map((jump) => ({ x: jump.time_ns / 1e9, colour: GREY, shape: "◇" })),
  ]);
  const speed = chart({ label: "speed", unit: "rad/s", height: 170, series: [{ label: "speed", colour: COLOURS[1] }] });
  const friction = chart({ label: "friction", unit: "mN m", height: 270, draw: jumps, series: [{ label: "measured", colour: "rgba(133,147,160,.55)", width: 0, points: true }, { label: "simulated", colour: COLOURS[0], width: 2 }] });
  const residual = chart({ label: "residual", unit: "mN m", height: 170, series: [{ label: "residual", colour: COLOURS[3], width: 0, points: true }] });
  const charts = [speed, friction, residual];
  const split = h("div", {});
  const trends = h("div", { class: "two" });
  let stack = null;
  let lines = [];
  const notice = h("p", { class: "soft" });

  if (store.live) backfill();
  async function backfill() {
    try {
      const [windows, trace] = await Promise.all([ask(`/api/wheels/${name}/windows?limit=200`), ask(`/api/wheels/${name}`)]);
      windows.forEach((one) => store.addDiagnosis(wheel, one));
      if (trace.samples && wheel.t.length < trace.samples.time_ns.length) {
        wheel.t = []; wheel.speed = []; wheel.friction = [];
        store.addSamples(wheel, trace.samples);
      }
      if (!wheel.jumps.length) wheel.jumps = trace.changepoints.flatMap((one) => one.changepoints);
      drawn = "";
      refresh();
    } catch (error) {
      notice.textContent = `Earlier windows cannot be shown: ${error.message}`;
    }
  }

  function refresh() {
    const diagnosis = last(wheel);
    const silent = store.silent(wheel);
    drawHead(diagnosis, silent);
    drawQuality(diagnosis, silent);
    const now = `${wheel.diagnoses.length} ${diagnosis?.window_end_ns} ${wheel.t.length} ${wheel.t[wheel.t.length - 1]} ${friction.element.clientWidth}`;
    if (now === drawn) return;
    drawn = now;
    if (diagnosis) systems = Object.keys(diagnosis.friction.fss);
    drawSamples();
    if (diagnosis) {
      drawTable(diagnosis);
      drawSplit();
      drawTrends(diagnosis);
    }
  }

  function drawHead(diagnosis, silent) {
    const verdict = diagnosis?.verdict ?? "waiting";
    const suspected = diagnosis && !diagnosis.model_adequate ? `The friction model does not fit${diagnosis.suspected_effect ? `; suspected: ${diagnosis.suspected_effect}` : ""}.` : null;
    head.replaceChildren(
      h("p", { class: `verdict ${silent ? "silent" : verdict}` }, `${SIGN[verdict] ?? "…"} ${verdict}${silent ? ", but stale: this is the last known state, not the present one" : ""}`),
      h("p", {}, h("b", {}, diagnosis?.reason ?? "The first window is being filled.")),
      diagnosis ? h("p", {}, diagnosis.explanation) : "",
      suspected ? h("p", { class: "inconclusive" }, suspected) : "",
      diagnosis ? h("p", { class: "soft" }, `Window ${wheelTime(diagnosis.window_start_ns)} to ${wheelTime(diagnosis.window_end_ns)}${since(diagnosis.verdict)}`) : "");
  }

  function since(verdict) {
    let first = wheel.diagnoses.length - 1;
    while (first > 0 && wheel.diagnoses[first - 1].verdict === verdict) first -= 1;
    return `; ${verdict} for ${wheel.diagnoses.length - first} windows`;
  }

  function drawTable(diagnosis) {
    table.replaceChildren(h("table", {},
      h("thead", {}, h("tr", {}, ["part", "anomaly", "probability", "estimate", "nominal range", "severity"].map((text) => h("th", { scope: "col" }, text)))),
      h("tbody", {}, Object.entries(diagnosis.anomalies).map(([part, one]) => h("tr", {},
        h("th", { scope: "row" }, part),
        h("td", { class: one.active ? "anomalous" : "nominal" }, one.active ? "▲ active" : "✓ none"),
        h("td", {}, percent(one.probability)),
        h("td", {}, quantity(one.estimate, one.unit)),
        h("td", {}, one.nominal_low === null ? "–" : `${quantity(one.nominal_low, one.unit)} to ${quantity(one.nominal_high, one.unit)}`),
        h("td", {}, one.severity === null ? "–" : `${number(one.severity)}${one.severity_std === null ? "" : ` ± ${number(one.severity_std)}`}`))))));
  }

  function drawQuality(diagnosis, silent) {
    const status = wheel.status;
    const facts = [["coverage", diagnosis ? percent(diagnosis.coverage) : "–"], ["noise", quantity(diagnosis?.fit.noise_std_Nm, "N m")], ["fit, rms residual", quantity(diagnosis?.fit.rmse_Nm, "N m")]];
    if (status) facts.push(
      ["monitor", silent ? `stale, heard ${age(store.now - wheel.heard)}` : "reporting"],
      ["running window", `${Math.round(100 * status.window_fill)} % full, ${wheel.jumps.length} jumps so far`],
      ["samples", `${status.samples_received} received, ${status.samples_used} used, ${status.samples_masked} masked, ${status.samples_late} late, ${status.samples_duplicate} duplicate, ${status.samples_rejected} rejected`],
      ["gaps", `${status.slots_missed} slots, ${status.messages_missed} messages missed, ${status.messages_dropped} dropped`],
      ["queue", String(status.queue_depth)], ["last error", status.last_error ?? "none"], ["recording", status.recording ?? "none"]);
    quality.replaceChildren(...facts.flatMap(([what, value]) => [h("dt", { class: "soft" }, what), h("dd", {}, value)]));
  }

  function drawSamples() {
    const step = Math.max(1, Math.ceil(wheel.t.length / MAX_DRAWN));
    const times = [], speeds = [], measured = [], model = [], rest = [];
    for (let i = 0; i < wheel.t.length; i += step) {
      const torque = wheel.friction[i], omega = wheel.speed[i];
      const against = torque === null || omega === null ? null : torque * Math.sign(omega);
      const expected = omega === null ? null : simulated(wheel.diagnoses, wheel.t[i] * 1e9, omega);
      times.push(wheel.t[i]); speeds.push(omega);
      measured.push(against === null ? null : against * 1e3);
      model.push(expected === null ? null : expected * 1e3);
      rest.push(against === null || expected === null ? null : (against - expected) * 1e3);
    }
    notice.textContent = times.length ? "" : "No samples here: they are drawn while they come over the bus, or from a recording.";
    speed.set([times, speeds]);
    friction.set([times, measured, model]);
    residual.set([times, rest]);
    key.replaceChildren(h("span", {}, "· measured, positive against the rotation"), h("span", {}, "— simulated from the diagnosis"), ...systems.map((one) => legend(one, one)), legend("", "not (yet) attributed"));
  }

  function legend(system, text) {
    const { colour, shape } = systemStyle(system, systems);
    const mark = h("span", {}, shape);
    mark.style.color = colour;
    return h("span", {}, mark, ` ${text}`);
  }

  /** Stacked: drawn from the whole to the first part, each over the one before. */
  function drawSplit() {
    const parts = ["base dry", `viscous at ${REFERENCE_SPEED} rad/s`, ...systems];
    const colours = [GREY, COLOURS[5], ...systems.map((one) => systemStyle(one, systems).colour)];
    if (!stack) {
      stack = chart({ label: "friction", unit: "mN m", zero: true, series: parts.map((part, i) => ({ label: part, colour: colours[i], fill: colours[i], width: 1, paths: uPlot.paths.bars({ size: [0.8, 60] }) })).reverse() });
      charts.push(stack);
      split.replaceChildren(stack.element, h("div", { class: "key" }, "from below: ", parts.map((part, i) => { const mark = h("span", {}, "█"); mark.style.color = colours[i]; return h("span", {}, mark, ` ${i + 1}. ${part}`); })));
    }
    const rows = wheel.diagnoses.map((one) => {
      let sum = 0;
      return [(one.friction.base_dry.value ?? 0) * 1e3, (one.friction.viscous.value ?? 0) * REFERENCE_SPEED * 1e3, ...systems.map((system) => (one.friction.fss[system] ? meanFriction(one.friction.fss[system], one.samples) * 1e3 : 0))].map((part) => (sum += part));
    });
    stack.set([wheel.diagnoses.map((one) => one.window_end_ns / 1e9), ...parts.map((_, i) => rows.map((row) => row[i])).reverse()]);
  }

  function drawTrends(diagnosis) {
    const names = Object.keys(diagnosis.anomalies);
    if (lines.length !== names.length) {
      lines = names.map((part) => {
        const [, unit] = SCALE[diagnosis.anomalies[part].unit] ?? [1, diagnosis.anomalies[part].unit];
        const one = chart({ label: part, unit, height: 180, series: [{ label: part, colour: COLOURS[1], points: true, size: 7 }, { label: "anomalous", colour: COLOURS[0], width: 0, points: true, size: 12 }], draw: (u) => { const now = last(wheel).anomalies[part]; const [factor] = SCALE[now.unit] ?? [1]; if (now.nominal_low !== null) band(u, now.nominal_low * factor, now.nominal_high * factor); } });
        charts.push(one);
        return { part, one };
      });
      trends.replaceChildren(...lines.map(({ one }) => one.element));
    }
    for (const { part, one } of lines) {
      const found = wheel.diagnoses.map((window) => window.anomalies[part]);
      const values = found.map((anomaly) => (anomaly?.estimate === null || anomaly === undefined ? null : anomaly.estimate * (SCALE[anomaly.unit]?.[0] ?? 1)));
      one.set([wheel.diagnoses.map((window) => window.window_end_ns / 1e9), values, values.map((value, i) => (found[i]?.active ? value : null))]);
    }
  }

  const element = h("div", {},
    h("p", {}, h("a", { href: `${base}/` }, "← all wheels")), h("h1", {}, `${wheel.spacecraft} / ${wheel.wheel}`), head,
    h("section", { class: "card" }, h("h2", {}, "Diagnosis of the latest window"), table),
    h("section", { class: "card" }, h("h2", {}, "Speed, friction and jumps"), notice, speed.element, friction.element, key, h("h2", {}, "Measured less simulated"), residual.element, h("p", { class: "soft" }, "Simulated: base dry and viscous friction and the switching systems. Jumps that fit no system stay in the residual.")),
    h("div", { class: "two" }, h("section", { class: "card" }, h("h2", {}, "Friction split, window by window"), split), h("section", { class: "card" }, h("h2", {}, "Data quality"), quality)),
    h("section", { class: "card" }, h("h2", {}, "Estimates over time"), h("p", { class: "soft" }, "Shaded: the nominal range. Large points: called anomalous."), trends));
  return { element, refresh, close: () => charts.forEach((one) => one.close()) };
}

async function ask(path) {
  const answer = await fetch(path);
  const content = await answer.json();
  if (!answer.ok) throw new Error(content.error);
  return content;
}
