import { retirementCard } from "./retired_wheels.js";
import { ask } from "./ask.js";
import { discrepancyReport } from "./discrepancy.js";
import { facts, h, table } from "./dom.js";
import { firstWindow, staleness } from "./fleet_view.js";
import { counted, number, percent, quantity, span, wheelTime, withStd } from "./format.js";
import { dataOf, last, noSamples } from "./store.js";
import { SIGN, colour, misfit, partVerdict, partsNote } from "./verdict.js";
import { estimatesBeside } from "./estimates_beside.js";
import { frictionLaws } from "./friction_laws.js";
import { estimateTrends, frictionSplit } from "./wheel_history.js";
import { wheelSamples } from "./wheel_samples.js";

/** One wheel: what is wrong and why, the friction and its parts, the quality of the data. */
export function wheelView(store, name, base) {
  const wheel = store.wheel(name);
  const head = h("section", { class: "card" });
  const parts = h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Diagnosis of the latest window" });
  const quality = h("dl", {});
  const samples = wheelSamples(store, wheel);
  const laws = frictionLaws(wheel);
  const beside = estimatesBeside(store, wheel, base);
  const split = frictionSplit(wheel);
  const trends = estimateTrends();
  const retirement = retirementCard(store, wheel);
  const report = h("section", { class: "card", hidden: true });
  const notice = h("p", { class: "inconclusive", role: "status", hidden: true });
  let drawn = "", reported = null, earlier = [], trendOf = null;
  let closed = false;

  if (store.live) backfill();
  /** What was before this page: asked for when it opens, and again after the server was away. */
  async function backfill() {
    try {
      const path = `/api/wheels/${name}`;
      const [windows, now, records, trend] = await Promise.all([ask(`${path}/windows?limit=200`), ask(path), ask(`${path}/estimates?limit=20000`), ask(`${path}/trend`)]);
      if (closed) return;
      windows.forEach((one) => store.addDiagnosis(wheel, one));
      if (now.samples && wheel.t.length < now.samples.time_ns.length) {
        Object.assign(wheel, noSamples());
        store.addSamples(wheel, now.samples);
      }
      if (last(wheel) && !(wheel.t[0] < last(wheel).window_end_ns / 1e9)) { // nothing came of the latest window since the server was started
        const recorded = await ask(`${path}/samples`);
        if (closed) return;
        store.addEarlierSamples(wheel, recorded);
      }
      if (!wheel.jumps.length) wheel.jumps = now.changepoints.flatMap((one) => one.changepoints);
      wheel.discrepancy ??= now.discrepancy;
      wheel.status ??= now.status;
      earlier = records;
      trendOf = Object.fromEntries(trend.map((one) => [one.name, one]));
      drawn = "";
      notice.hidden = true;
      refresh();
    } catch (error) {
      notice.hidden = false;
      notice.textContent = `Earlier windows cannot be shown now: ${error.message}. Trying again…`;
      if (!closed) setTimeout(() => closed || backfill(), 5000);
    }
  }

  function refresh() {
    const diagnosis = last(wheel);
    const state = store.state(wheel);
    drawHead(diagnosis, state);
    drawQuality(diagnosis, state);
    drawReport();
    beside.refresh();
    retirement.refresh(state);
    const now = `${wheel.diagnoses.length} ${diagnosis?.window_end_ns} ${wheel.t.length} ${wheel.t[wheel.t.length - 1]} ${samples.width} ${document.documentElement.dataset.theme}`;
    if (now === drawn) return;
    drawn = now;
    const systems = diagnosis ? Object.keys(diagnosis.friction.fss) : [];
    samples.refresh(systems);
    laws.refresh();
    if (diagnosis) {
      drawTable(diagnosis);
      split.refresh(systems);
      trends.refresh(records(), trendOf, Object.keys(diagnosis.anomalies));
    }
  }

  /** The history's estimates, and those of the windows since. */
  function records() {
    const known = earlier.length ? earlier[earlier.length - 1].window_end_ns : -1;
    const later = wheel.diagnoses.filter((one) => one.window_end_ns > known);
    return [...earlier, ...later.flatMap((one) => Object.entries(one.anomalies).map(([part, found]) => ({ name: part, window_end_ns: one.window_end_ns, value: found.estimate, ...found })))];
  }

  function drawHead(diagnosis, state) {
    const verdict = diagnosis?.verdict ?? "waiting";
    const stale = staleness(store, wheel, state);
    const lines = [
      ["verdict " + (stale ? "silent" : diagnosis ? colour(diagnosis) : verdict), `${SIGN[verdict] ?? "…"} ${verdict}${stale && diagnosis ? " (last known)" : ""}`],
      stale ? ["silent stale-note", `◌ ${stale}.${state === "unserved" ? "" : " This is the last known state, not the present one."}`] : null,
      dataOf(wheel, diagnosis) ? ["stale-note", `◷ ${dataOf(wheel, diagnosis)}.`] : null,
      ["strong", diagnosis?.reason ?? (store.connected || !store.live ? firstWindow(wheel, state) : "Loading…")],
      diagnosis ? ["", diagnosis.explanation] : null,
      diagnosis && misfit(diagnosis) ? ["inconclusive", `? ${misfit(diagnosis)}`] : null,
      diagnosis ? ["soft", `Window ${wheelTime(diagnosis.window_start_ns)} to ${wheelTime(diagnosis.window_end_ns)}${since(diagnosis)}`] : null,
    ].filter(Boolean);
    const now = JSON.stringify(lines);
    if (head.dataset.drawn === now) return;
    head.dataset.drawn = now;
    head.replaceChildren(...lines.map(([kind, text]) => h("p", { class: kind }, text)));
  }

  function since(diagnosis) {
    if (!wheel.verdicts?.since_ns) return "";
    const { windows, since_ns: begin } = wheel.verdicts;
    return `; ${diagnosis.verdict} for ${counted(windows, "window")}, since ${wheelTime(begin)} (${span((diagnosis.window_end_ns - begin) / 1e9)})`;
  }

  function drawTable(diagnosis) {
    const rows = Object.entries(diagnosis.anomalies).map(([part, one]) => h("tr", {},
      h("th", { scope: "row" }, part),
      partCell(...partVerdict(diagnosis, one)),
      h("td", {}, percent(one.probability)),
      h("td", {}, quantity(one.estimate, one.unit)),
      h("td", {}, one.nominal_low === null ? "–" : `${quantity(one.nominal_low, one.unit)} to ${quantity(one.nominal_high, one.unit)}`),
      h("td", {}, one.severity === null ? "–" : withStd(one.severity, one.severity_std))));
    parts.replaceChildren(table(["part", "anomaly", "probability", "estimate", "nominal range", "severity"], rows), h("p", { class: "soft note" }, partsNote(diagnosis)));
  }

  function drawQuality(diagnosis, state) {
    const status = wheel.status;
    const known = [["coverage", diagnosis ? percent(diagnosis.coverage) : "–"], ["noise", quantity(diagnosis?.fit.noise_std_Nm, "N m")], ["fit, rms residual", quantity(diagnosis?.fit.rmse_Nm, "N m")]];
    if (status) known.push(
      ["monitor", state === "silent" ? staleness(store, wheel, state) : "✓ reporting"],
      ["telemetry", telemetry(state)],
      ["data", status.data],
      ["latest sample", status.last_sample_ns === null ? "none yet" : wheelTime(status.last_sample_ns)],
      ["running window", `${Math.round(100 * status.window_fill)} % full, ${counted(wheel.jumps.length, "jump")} so far`],
      ["samples", `${status.samples_received} received, ${status.samples_used} used, ${status.samples_masked} masked, ${status.samples_late} late, ${status.samples_duplicate} duplicate, ${status.samples_rejected} rejected, ${status.samples_queued} queued`],
      ["gaps", `${counted(status.slots_missed, "slot")} missed`],
      ["messages", `${status.messages_missed} missed, ${status.messages_dropped} dropped, ${status.messages_rejected} rejected`],
      ["lag", `${counted(status.queue_depth, "message")} ${status.queue_depth === 1 ? "waits" : "wait"}; last diagnosis took ${status.diagnosis_s === null ? "–" : `${number(1e3 * status.diagnosis_s)} ms`}`],
      ["last error", status.last_error ?? "none"], ["recording", status.recording ?? "none"], ["software", status.software]);
    const now = JSON.stringify(known);
    if (quality.dataset.drawn === now) return;
    quality.dataset.drawn = now;
    quality.replaceChildren(...facts(known));
  }

  function telemetry(state) {
    if (!wheel.telemetry) return "–";
    if (state === "starved") return staleness(store, wheel, state);
    return `✓ ${state === "live" ? `samples ${span(store.starvedFor(wheel))} ago` : "not known now"}, stale after ${span(wheel.telemetry.stale_after_s)}`;
  }

  function drawReport() {
    if (wheel.discrepancy === reported) return;
    reported = wheel.discrepancy;
    report.hidden = !reported;
    if (reported) report.replaceChildren(h("h2", {}, "Discrepancy report"), ...discrepancyReport(reported));
  }

  const element = h("div", {},
    h("p", {}, h("a", { href: `${base}/` }, "← all wheels")), h("h1", {}, `${wheel.spacecraft} / ${wheel.wheel}`), notice, head,
    h("section", { class: "card" }, h("h2", {}, "Diagnosis of the latest window"), parts),
    beside.element, report, samples.element, laws.element,
    h("div", { class: "two" }, h("section", { class: "card" }, h("h2", {}, "Friction split, window by window"), split.element), h("section", { class: "card" }, h("h2", {}, "Data quality"), quality)),
    h("section", { class: "card" }, h("h2", {}, "Estimates over time"), trends.element),
    retirement.element);
  return { element, refresh, refill: backfill, close: () => { closed = true; [samples, laws, split, trends].forEach((one) => one.close()); } };
}

const partCell = (kind, text) => h("td", { class: kind }, text);
