import { h } from "./dom.js";
import { percent, quantity, signed, utc, wheelTime, withStd } from "./format.js";
import { LEVELS, badge } from "./levels.js";
import { signature } from "./signature.js";
import { isStored, last } from "./store.js";

const HOURS = [1, 8, 24, 168];
const MONITOR = "monitor"; // the alarm of a monitor that does not report: one process that died is one card
const ALL_WHEELS = "all_wheels"; // in place of a wheel: the alarm of what all wheels of a spacecraft share
const TOGETHER_NS = 10e9;

/** Whether an alarm is shelved, for now. */
export const shelved = (alarm, now) => alarm.closed_ns === null && (alarm.shelved_until_wall_ns ?? 0) / 1e6 > now;

/** All alarms: open ones first, the worst first, then shelved ones and those of stored data, then closed ones. */
export function alarmsView(store) {
  const list = h("div", {});
  let drawn = "";

  function refresh({ changed = false } = {}) {
    const group = (alarm) => (alarm.closed_ns !== null ? 2 : shelved(alarm, store.now) || retired(alarm) || isStored(alarm) ? 1 : 0);
    const all = [...store.alarms.values()].map((alarm) => ({ alarm, group: group(alarm) }));
    all.sort((a, b) => a.group - b.group || LEVELS.indexOf(b.alarm.level) - LEVELS.indexOf(a.alarm.level) || b.alarm.id - a.alarm.id);
    const cards = gathered(all);
    const now = JSON.stringify([all, all.map(({ alarm }) => latestOf(alarm)?.window_end_ns), store.connected]);
    if (now === drawn) return;
    // While somebody writes, or presses a button, what is written and pressed stays; after a change all is drawn.
    if (!changed && list.querySelector("form :is(:focus, :active)")) return;
    drawn = now;
    list.replaceChildren(...cards.map(({ alarms, group }) => card(alarms, group)));
    if (!all.length) list.replaceChildren(h("p", { class: "empty" }, store.connected ? "No alarm so far." : "Loading…"));
  }

  /** The latest window of the alarm's wheel, null where none is known. */
  const latestOf = (alarm) => { const wheel = store.wheels.get(`${alarm.spacecraft}/${alarm.wheel}`); return wheel ? last(wheel) : null; };

  const retired = (alarm) => store.isRetired(`${alarm.spacecraft}/${alarm.wheel}`);

  function card(alarms, group) {
    const [alarm] = alarms;
    const open = group < 2;
    const sign = !open ? ["✓ cleared"] : [group === 1 ? `‖ ${retired(alarm) ? "wheel retired" : isStored(alarm) ? "stored data" : "shelved"} ` : null, badge(alarm.level)];
    const several = alarms.length > 1;
    const whose = several ? `${alarms.length} wheels` : alarm.wheel === ALL_WHEELS ? `${alarm.spacecraft} / all wheels` : `${alarm.spacecraft} / ${alarm.wheel}`;
    return h("section", { class: "card", "aria-label": open ? `Alarm ${alarm.name} of ${whose}` : null },
      h("h2", { class: group === 0 ? "" : "soft" }, sign, ` ${whose} · ${alarm.name}`),
      h("p", {}, alarm.reason),
      open ? latestFigures(alarm, latestOf(alarm)) : null,
      open ? h("p", { class: "advice" }, h("strong", {}, "To do: "), alarm.advice) : null,
      h("p", { class: "soft" }, `Worst so far: ${alarm.peak}. ${raised(alarm)} ${phase(alarm)}${shelved(alarm, store.now) ? ` Shelved by ${lastOf(alarm, "shelved").person} until ${utc(alarm.shelved_until_wall_ns)}, or until it gets worse.` : ""}`),
      several ? h("p", {}, "Wheels: ", alarms.flatMap((one) => [h("a", { href: `#/wheel/${one.spacecraft}/${one.wheel}` }, `${one.spacecraft} / ${one.wheel}`), " "])) : alarm.wheel === ALL_WHEELS ? null : h("a", { href: `#/wheel/${alarm.spacecraft}/${alarm.wheel}` }, "Show the wheel"),
      open ? form(alarms) : null,
      h("details", {}, h("summary", {}, `Audit trail (${several ? `of each; that of ${alarm.wheel}: ` : ""}${alarm.trail.length})`), h("ul", {}, alarm.trail.map((line) => h("li", {}, `${utc(line.wall_ns)}: ${line.event}, ${line.level}${signed(line)}`)))));
  }

  function form(alarms) {
    const [alarm] = alarms;
    const who = signature();
    const hours = h("select", { "aria-label": "Shelve for" }, HOURS.map((n) => h("option", { value: n }, n < 48 ? `${n} h` : `${n / 24} d`)));
    const change = (what, done, extra) => who.post(alarms.map((one) => `/api/alarms/${one.id}/${what}`), extra, done, (content) => {
      store.alarms.set(content.id, content);
      store.worst = null;
      refresh({ changed: true });
    });
    const shelve = (seconds) => change("shelve", seconds ? "shelved" : "brought back", { seconds });
    return h("form", { onsubmit: (event) => { event.preventDefault(); if (alarm.phase !== "acknowledged") change("acknowledge", "acknowledged", {}); } }, who.fields,
      alarm.phase === "acknowledged" ? null : h("button", {}, "Acknowledge"),
      shelved(alarm, store.now) ? h("button", { type: "button", onclick: () => shelve(0) }, "Bring back") : [h("button", { type: "button", onclick: () => shelve(3600 * Number(hours.value)) }, "Shelve for"), hours],
      who.problem);
  }

  refresh();
  return { element: h("div", {}, h("h1", {}, "Alarms"), list), refresh };
}

/** Cards in the order of the alarms: open alarms of monitors that came together and stand alike make one. */
function gathered(all) {
  const cards = [];
  for (const { alarm, group } of all) {
    const like = (card) => card.group === group && card.alarms[0].name === MONITOR && card.alarms[0].phase === alarm.phase && Math.abs(card.alarms[0].trail[0].wall_ns - alarm.trail[0].wall_ns) < TOGETHER_NS;
    const card = alarm.name === MONITOR && group < 2 ? cards.find(like) : undefined;
    if (card) card.alarms.push(alarm);
    else cards.push({ alarms: [alarm], group });
  }
  return cards;
}

/** When an alarm rose: that of a monitor by the clock of the machine that missed it. */
const raised = (alarm) => (alarm.name === MONITOR ? `Raised at ${utc(alarm.trail[0].wall_ns)}.` : `Raised with the window to ${wheelTime(alarm.raised_ns)}.`);

/** What the latest window shows of the alarm's part: the reason above keeps the figures of the window that raised it. */
function latestFigures(alarm, latest) {
  const part = latest?.anomalies[alarm.name];
  if (!part) return null;
  const severity = part.severity === null ? "" : `, severity ${withStd(part.severity, part.severity_std)}`;
  return h("p", { class: "soft" }, `These are the figures of the window in which it was raised or last rose. The latest one, to ${wheelTime(latest.window_end_ns)}: ${latest.verdict}, ${quantity(part.estimate, part.unit)}, probability ${percent(part.probability)}${severity}.`);
}

const lastOf = (alarm, event) => alarm.trail.findLast((line) => line.event === event);

function phase(alarm) {
  if (alarm.closed_ns !== null) return "Normal again and acknowledged.";
  if (alarm.phase === "acknowledged") return `Acknowledged by ${lastOf(alarm, "acknowledged").person} at ${utc(lastOf(alarm, "acknowledged").wall_ns)}; clears when normal again.`;
  if (alarm.phase === "returned") return "Normal again; clears when acknowledged.";
  return "Not acknowledged.";
}
