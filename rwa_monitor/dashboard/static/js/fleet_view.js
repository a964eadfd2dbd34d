import { ask } from "./ask.js";
import { retiredList } from "./retired_wheels.js";
import { h } from "./dom.js";
import { age, counted, number, percent, span } from "./format.js";
import { heatStrip, inWords } from "./heat_strip.js";
import { badge } from "./levels.js";
import { dataOf, isStored, last, worstSeverity } from "./store.js";
import { SIGN, colour, misfit } from "./verdict.js";

const ORDER = { anomalous: 0, inconclusive: 2, nominal: 4 };
let search = "";

const RETRY_MS = 5000;

/** All wheels, the worst first. What is stale is marked, and stands behind what is as bad and live. Above them what
 *  changed since the last visit, where the page gives it, and the last windows of all. */
export function fleetView(store, base, visit = null) {
  const list = h("div", {});
  const summary = h("p", { class: "soft", role: "status" });
  const field = h("input", { type: "search", placeholder: "search wheels, reasons", "aria-label": "Search wheels", value: search });
  field.addEventListener("input", () => { search = field.value; refresh(); });
  const rows = new Map();
  const nothing = h("p", { class: "empty" });
  const retired = retiredList(store, base);
  const strip = heatStrip((name) => { location.hash = `${base.slice(1)}/wheel/${name}`; });
  let closed = false;

  if (store.live) backfill();
  /** The verdicts of windows from before this page. */
  async function backfill() {
    try {
      store.addVerdicts(await ask("/api/verdicts"));
      if (!closed) refresh();
    } catch {
      setTimeout(() => closed || backfill(), RETRY_MS); // the page shows by itself that the server is away
    }
  }

  function refresh() {
    retired.refresh(matches);
    const wheels = [...store.wheels.values()].filter((wheel) => !store.isRetired(wheel.name) && matches(wheel)).map((wheel) => {
      const state = store.state(wheel);
      return { wheel, state, rank: rank(store, wheel, state), worst: worstSeverity(last(wheel)) };
    });
    strip.refresh(wheels);
    visit?.refresh();
    wheels.sort((a, b) => a.rank - b.rank || b.worst - a.worst || (a.wheel.name < b.wheel.name ? -1 : 1));
    place(wheels.map(({ wheel, state }) => row(wheel, state)));
    if (!wheels.length) {
      nothing.textContent = search ? "No wheel matches." : store.wheels.size ? "All wheels are retired." : nobody();
      list.replaceChildren(nothing);
    }
    const live = wheels.filter(({ state }) => state === "live");
    const bad = wheels.filter(({ wheel }) => last(wheel)?.verdict === "anomalous").length;
    const alarms = store.openAlarms().filter((alarm) => !isStored(alarm)).length;
    const text = store.live && !store.connected && !wheels.length ? "Loading…" : store.live ? `${live.length} of ${counted(wheels.length, "wheel")} reporting, ${bad} anomalous, ${counted(alarms, "open alarm")}` : `${counted(wheels.length, "wheel")}, ${bad} anomalous`;
    if (summary.textContent !== text) summary.textContent = text;
  }

  function nobody() {
    if (!store.live) return "Nothing has happened yet at this time of the recording. Play it, or go to the next window.";
    return store.connected ? "No wheel has reported yet. Start a monitor (rwa-monitor run) on the same bus, or open a recording." : "Loading…";
  }

  /** Bring the rows into order, moving only those that stand wrong. */
  function place(wanted) {
    let at = list.firstChild;
    for (const element of wanted) {
      if (element === at) at = at.nextSibling;
      else list.insertBefore(element, at);
    }
    while (at) {
      const next = at.nextSibling;
      at.remove();
      at = next;
    }
  }

  function matches(wheel) {
    if (!search) return true;
    const diagnosis = last(wheel);
    return `${wheel.name} ${diagnosis?.verdict} ${diagnosis?.reason}`.toLowerCase().includes(search.toLowerCase());
  }

  function row(wheel, state) {
    let entry = rows.get(wheel.name);
    if (!entry) rows.set(wheel.name, (entry = newRow(wheel)));
    // Ages move without a message: those of what is stale every second, others with the next status.
    const alarm = store.worstAlarm(wheel.name);
    const now = `${wheel.version} ${alarm?.id} ${alarm?.level} ${alarm?.phase} ${state} ${state === "live" ? "" : Math.floor(store.now / 1000)}`;
    if (entry.drawn !== now) {
      entry.drawn = now;
      drawRow(entry, wheel, state);
    }
    return entry.element;
  }

  function newRow(wheel) {
    const parts = { verdict: h("span", {}), reason: h("span", {}), alarm: h("span", { class: "alarm" }), since: h("span", { class: "soft" }), age: h("span", { class: "age" }), windows: h("span", { class: "unseen" }) };
    const element = h("a", { href: `${base}/wheel/${wheel.name}` }, parts.verdict, h("b", {}, wheel.wheel, h("br"), h("span", { class: "soft" }, wheel.spacecraft)), h("span", { class: "reason" }, parts.reason, h("br"), parts.alarm, parts.since, parts.windows), parts.age);
    return { element, parts, drawn: "", texts: {} };
  }

  function drawRow({ element, parts, texts }, wheel, state) {
    // Most of a row is as it was: a thousand rows of which nothing is written need no layout.
    const put = (name, text) => { if (texts[name] !== text) parts[name].textContent = texts[name] = text; };
    const kind = (one, name) => { if (one.className !== name) one.className = name; };
    const diagnosis = last(wheel);
    const stale = state !== "live";
    const verdict = diagnosis?.verdict ?? "waiting";
    const shown = diagnosis ? colour(diagnosis) : verdict;
    kind(element, `wheel is-${shown}${stale ? " is-stale" : ""}`);
    kind(parts.verdict, `verdict ${stale ? "silent" : shown}`);
    put("verdict", `${SIGN[verdict] ?? "…"} ${verdict}${diagnosis && shown !== verdict ? "\n? model misfit" : ""}${state === "unserved" ? "\n◌ not monitored" : stale ? "\n◌ stale" : ""}`);
    put("reason", `${LEAD[state]}${diagnosis?.reason ?? firstWindow(wheel, state)}`);
    const alarm = store.worstAlarm(wheel.name);
    if (texts.level !== alarm?.level) parts.alarm.replaceChildren(...(alarm ? [badge(alarm.level), " "] : []));
    texts.level = alarm?.level;
    const facts = [dataOf(wheel, diagnosis), alarm?.name === "monitor" ? `monitor${alarm.phase === "returned" ? " was" : ""} not reporting` : "", alarm?.phase === "active" ? "not acknowledged" : "", ...(diagnosis ? [since(wheel, diagnosis), misfit(diagnosis)] : [])];
    put("since", facts.filter(Boolean).join("; "));
    const windows = `${diagnosis?.window_end_ns} ${wheel.diagnoses.length} ${wheel.earlier.length}`;
    if (texts.of !== windows) put("windows", inWords(wheel));
    texts.of = windows;
    put("age", staleness(store, wheel, state) ?? (wheel.refused ? "messages refused" : fill(wheel)));
  }

  refresh();
  const element = h("div", {}, h("h1", {}, store.live ? "Fleet" : "Fleet in this recording"), visit?.element, strip.element, h("div", { class: "row" }, field, summary), list, retired.element);
  return { element, refresh, refill: store.live ? backfill : null, close: () => { closed = true; } };
}

const LEAD = { live: "", silent: "Not reporting now; last known state: ", starved: "No telemetry now; last known state: ", recorded: "Last known state: ", unserved: "" };

/** Why what is shown of a wheel is not its present, null where it is. */
export function staleness(store, wheel, state) {
  if (state === "silent") return `stale: monitor reported ${age(store.now - wheel.reported)}`;
  if (state === "starved") return `stale: no telemetry for ${span(store.starvedFor(wheel))}, expected within ${span(wheel.telemetry.stale_after_s)}`;
  if (state === "unserved") return "no monitor reports";
  return state === "recorded" ? "stale, from the history" : null;
}

/** The text of a wheel before its first diagnosis. */
export const firstWindow = (wheel, state) => (state === "unserved" ? "No monitor reports on this wheel: nothing of it is diagnosed." : wheel.refused ? `No message of this wheel can be used: ${wheel.refused}.` : "The first window is being filled.");

const fill = (wheel) => `window ${Math.round(100 * wheel.fill)} % full`;

/** How sure, and since when: on the wheel's own clock, in which its windows are. */
function since(wheel, diagnosis) {
  const active = Object.values(diagnosis.anomalies).filter((one) => one.active);
  const sure = active.length ? `probability ${percent(Math.max(...active.map((one) => one.probability)))}, severity ${number(worstSeverity(diagnosis))}` : "";
  if (!wheel.verdicts?.since_ns) return sure;
  const windows = wheel.verdicts.windows;
  return `${sure ? `${sure}; ` : ""}${diagnosis.verdict} for ${counted(windows, "window")}, ${span((diagnosis.window_end_ns - wheel.verdicts.since_ns) / 1e9)}`;
}

/** A wheel with an alarm that nobody has acknowledged stands as high as an anomalous one, live or not. */
function rank(store, wheel, state) {
  if (store.worstAlarm(wheel.name)?.phase === "active") return Math.min(1, ORDER[last(wheel)?.verdict] ?? 1);
  return (state === "recorded" || state === "unserved" ? 10 : state === "live" ? 0 : 1) + (ORDER[last(wheel)?.verdict] ?? 3);
}
