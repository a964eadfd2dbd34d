/** What has changed since the last visit, in one sentence. Kept in this browser only; the server keeps nothing of it.
 *  A visit ends when the page was closed, or hidden, for some minutes. */
import { h } from "./dom.js";
import { age, counted, utc } from "./format.js";
import { REPLAY, isStored, last } from "./store.js";

const ITEM = "rwa-monitor visits";
const PAUSE_MS = 300e3;
const KEEP_MS = 10e3;
const NAMED = 3; // wheels that are named, the others counted

export function visits(store) {
  const text = h("span", {});
  const button = h("button", { type: "button", onclick: () => { before = picture(); keep(); refresh(); } }, "Mark all as seen");
  const element = h("p", { class: "row visit", hidden: true }, text, button);
  let before = null, kept = 0;

  /** Begin a visit, or go on with the one that was interrupted. */
  function begin() {
    const found = load();
    before = (found.seen && Date.now() - found.seen.at > PAUSE_MS ? found.seen : found.before) ?? null;
  }

  function refresh() {
    if (!store.connected || !store.wheels.size) return;
    if (!document.hidden && Date.now() - kept > KEEP_MS) keep();
    const now = before ? sentence(before) : "";
    if (text.textContent !== now) text.textContent = now;
    element.hidden = !now;
  }

  function keep() {
    kept = Date.now();
    save({ before, seen: picture() });
  }

  const picture = () => ({ at: Date.now(), wheels: Object.fromEntries([...store.wheels.values()].filter((wheel) => !store.isRetired(wheel.name) && !wheel.wheel.endsWith(REPLAY)).map((wheel) => [wheel.name, last(wheel)?.verdict ?? ""])) });

  function sentence(then) {
    const now = picture();
    const names = Object.keys(now.wheels);
    const known = names.filter((name) => name in then.wheels);
    const changed = (verdict) => known.filter((name) => now.wheels[name] === verdict && then.wheels[name] !== verdict);
    const verdicts = ["anomalous", "inconclusive", "nominal"].flatMap((verdict) => groups(changed(verdict), then).map(([was, wheels]) => `${list(wheels, store)} went from ${was || "no window"} to ${verdict}`));
    const events = [...store.alarms.values()].filter((alarm) => !isStored(alarm)).map((alarm) => alarm.trail.filter((line) => line.wall_ns / 1e6 > then.at).map((line) => line.event));
    const alarms = ["raised", "acknowledged", "cleared"].map((event) => [event, events.filter((one) => one.includes(event)).length]).filter(([, count]) => count).map(([word, count]) => `${counted(count, "alarm")} ${count > 1 ? "were" : "was"} ${word}`);
    const added = names.length - known.length, gone = Object.keys(then.wheels).filter((name) => !(name in now.wheels)).length;
    const fleet = [added ? `${counted(added, "wheel")} ${added > 1 ? "are" : "is"} new` : "", gone ? `${counted(gone, "wheel")} left the list` : ""];
    const facts = [...verdicts, ...alarms, ...fleet].filter(Boolean);
    const since = `your last visit, ${age(now.at - then.at)} (${utc(then.at * 1e6)})`;
    return facts.length ? `Since ${since}: ${facts.join("; ")}.` : `Nothing has changed since ${since}.`;
  }

  begin();
  addEventListener("pagehide", () => { if (store.connected && !document.hidden) keep(); });
  document.addEventListener("visibilitychange", () => { if (document.hidden) keep(); else begin(); });
  return { element, refresh };
}

/** Wheels by the verdict that they had. */
function groups(names, then) {
  const found = new Map();
  for (const name of names) found.set(then.wheels[name], [...(found.get(then.wheels[name]) ?? []), name]);
  return [...found];
}

const list = (names, store) => names.slice(0, NAMED).map((name) => `${name.replace("/", " / ")}${because(last(store.wheel(name)))}`).join(", ") + (names.length > NAMED ? ` and ${names.length - NAMED} more` : "");

/** The parts that are anomalous, "" where none is. */
function because(diagnosis) {
  const parts = diagnosis?.verdict === "anomalous" ? Object.entries(diagnosis.anomalies).filter(([, one]) => one.active).map(([part]) => part.replaceAll("_", " ")) : [];
  return parts.length ? ` (${parts.join(", ")})` : "";
}

/** A browser may refuse to keep anything: then there is no last visit. */
function load() {
  try {
    return JSON.parse(localStorage.getItem(ITEM)) ?? {};
  } catch {
    return {};
  }
}

function save(content) {
  try {
    localStorage.setItem(ITEM, JSON.stringify(content));
  } catch { /* nothing is kept then */ }
}
