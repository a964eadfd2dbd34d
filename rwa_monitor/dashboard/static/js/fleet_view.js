import { h } from "./dom.js";
import { SIGN, age, number } from "./format.js";
import { last } from "./store.js";

const ORDER = { anomalous: 0, inconclusive: 1, nominal: 2 };
let search = "";

/** All wheels, the worst first; those that are not heard come after those that are. */
export function fleetView(store, base) {
  const list = h("div", {});
  const summary = h("p", { class: "soft", role: "status" });
  const field = h("input", { type: "search", placeholder: "search wheels, reasons", "aria-label": "Search wheels", value: search });
  field.addEventListener("input", () => { search = field.value; refresh(); });
  const rows = new Map();

  function refresh() {
    const wheels = [...store.wheels.values()].filter((wheel) => matches(wheel));
    wheels.sort((a, b) => rank(store, a) - rank(store, b) || worst(b) - worst(a) || a.name.localeCompare(b.name));
    const wanted = wheels.map((wheel) => row(wheel));
    if (wanted.length !== list.children.length || wanted.some((element, i) => list.children[i] !== element)) list.replaceChildren(...wanted);
    if (!wheels.length) list.replaceChildren(h("p", { class: "empty" }, store.wheels.size ? "No wheel matches." : "No wheel has been heard yet. Start a monitor (rwa-monitor run) on the same bus, or open a recording."));
    const heard = wheels.filter((wheel) => !store.silent(wheel));
    const bad = heard.filter((wheel) => last(wheel)?.verdict === "anomalous").length;
    summary.textContent = `${heard.length} of ${wheels.length} wheels reporting, ${bad} anomalous, ${store.openAlarms().length} open alarms`;
  }

  function matches(wheel) {
    const diagnosis = last(wheel);
    return `${wheel.name} ${diagnosis?.verdict} ${diagnosis?.reason}`.toLowerCase().includes(search.toLowerCase());
  }

  function row(wheel) {
    const diagnosis = last(wheel);
    const silent = store.silent(wheel);
    const verdict = diagnosis?.verdict ?? "waiting";
    let entry = rows.get(wheel.name);
    if (!entry) {
      const parts = { verdict: h("span", {}), reason: h("span", { class: "reason" }), age: h("span", { class: "age" }) };
      const element = h("a", { href: `${base}/wheel/${wheel.name}` }, parts.verdict, h("b", {}, wheel.wheel, h("br"), h("span", { class: "soft" }, wheel.spacecraft)), parts.reason, parts.age);
      rows.set(wheel.name, (entry = { element, parts }));
    }
    const { element, parts } = entry;
    element.className = `wheel is-${silent ? "silent" : verdict}`;
    parts.verdict.className = `verdict ${silent ? "silent" : verdict}`;
    parts.verdict.textContent = `${SIGN[verdict] ?? "…"} ${verdict}${trend(wheel)}`;
    parts.reason.textContent = (silent ? "Not heard now; last known: " : "") + (diagnosis?.reason ?? `The first window is being filled (${number(100 * (wheel.status?.window_fill ?? 0))} %).`);
    parts.age.textContent = silent ? (wheel.heard ? `stale, heard ${age(store.now - wheel.heard)}` : "stale, from the history") : `window ${Math.round(100 * (wheel.status?.window_fill ?? 0))} % full`;
    return element;
  }

  refresh();
  return { element: h("div", {}, h("h1", {}, store.live ? "Fleet" : "Fleet in this recording"), h("div", { class: "row" }, field, summary), list), refresh };
}

function worst(wheel) {
  return Math.max(0, ...Object.values(last(wheel)?.anomalies ?? {}).map((anomaly) => (anomaly.active ? anomaly.severity ?? 0 : 0)));
}

function rank(store, wheel) {
  return (store.silent(wheel) ? 10 : 0) + (ORDER[last(wheel)?.verdict] ?? 3);
}

/** An arrow where the worst anomaly's severity moves by more than a tenth from one window to the next. */
function trend(wheel) {
  if (wheel.diagnoses.length < 2 || last(wheel).verdict !== "anomalous") return "";
  const before = worst({ diagnoses: wheel.diagnoses.slice(0, -1) });
  const change = worst(wheel) - before;
  return change > 0.1 ? "\n↑ worse" : change < -0.1 ? "\n↓ better" : "\n→ steady";
}
