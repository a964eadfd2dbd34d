import { ask } from "./ask.js";
import { h } from "./dom.js";
import { utc, wheelTime } from "./format.js";
import { setToken, token } from "./token.js";

const MARK = { watch: "○ watch", warning: "◐ warning", distress: "● distress", critical: "⬤ critical", normal: "✓ normal again" };
const LEVELS = ["normal", "watch", "warning", "distress", "critical"];

/** All alarms: open ones first, the worst first; acknowledge with name and note. */
export function alarmsView(store) {
  const list = h("div", {});
  let drawn = "";

  function refresh() {
    const all = [...store.alarms.values()].sort((a, b) => (a.closed_ns === null ? 0 : 1) - (b.closed_ns === null ? 0 : 1) || LEVELS.indexOf(b.level) - LEVELS.indexOf(a.level) || b.id - a.id);
    const now = JSON.stringify(all);
    if (now === drawn) return;
    if (drawn && list.contains(document.activeElement) && document.activeElement.tagName === "INPUT") return; // somebody is writing
    drawn = now;
    list.replaceChildren(...all.map((alarm) => card(alarm)));
    if (!all.length) list.replaceChildren(h("p", { class: "empty" }, "No alarm so far."));
  }

  function card(alarm) {
    const open = alarm.closed_ns === null;
    const needs = open && alarm.phase !== "acknowledged";
    return h("section", { class: "card", "aria-label": `Alarm ${alarm.name} of ${alarm.wheel}` },
      h("h2", { class: open && alarm.level !== "normal" ? "anomalous" : "soft" }, `${open ? MARK[alarm.level] : "✓ cleared"} · ${alarm.spacecraft} / ${alarm.wheel} · ${alarm.name}`),
      h("p", {}, alarm.reason),
      h("p", { class: "soft" }, `Worst so far: ${alarm.peak}. Raised with the window to ${wheelTime(alarm.raised_ns)}. ${phase(alarm)}`),
      h("a", { href: `#/wheel/${alarm.spacecraft}/${alarm.wheel}` }, "Show the wheel"),
      needs ? form(alarm) : null,
      h("details", {}, h("summary", {}, `Audit trail (${alarm.trail.length})`), h("ul", {}, alarm.trail.map((line) => h("li", {}, `${utc(line.wall_ns)}: ${line.event}, ${line.level}${line.person ? ` by ${line.person}` : ""}${line.note ? `: “${line.note}”` : ""}`)))));
  }

  function form(alarm) {
    const name = h("input", { name: "name", placeholder: "your name", "aria-label": "Your name", required: true, maxlength: 100 });
    const note = h("input", { name: "note", placeholder: "note (optional)", "aria-label": "Note", maxlength: 2000 });
    const secret = h("input", { name: "token", type: "password", autocomplete: "off", placeholder: "token", "aria-label": "Token", hidden: true });
    const problem = h("span", { role: "alert", class: "anomalous" });
    return h("form", { onsubmit: async (event) => {
      event.preventDefault();
      try {
        if (!secret.hidden) setToken(secret.value);
        const content = await ask(`/api/alarms/${alarm.id}/acknowledge`, { method: "POST", headers: { Authorization: `Bearer ${token()}`, "Content-Type": "application/json" }, body: JSON.stringify({ name: name.value, note: note.value }) });
        store.alarms.set(content.id, content);
        name.blur();
        refresh();
      } catch (error) {
        if (error.status === 401) secret.hidden = false; // whoever has it can write it here
        problem.textContent = `Not acknowledged: ${error.message}`;
      }
    } }, name, note, secret, h("button", {}, "Acknowledge"), problem);
  }

  refresh();
  return { element: h("div", {}, h("h1", {}, "Alarms"), list), refresh };
}

function phase(alarm) {
  if (alarm.closed_ns !== null) return "Normal again and acknowledged.";
  const seen = alarm.trail.findLast((line) => line.event === "acknowledged");
  if (alarm.phase === "acknowledged") return `Acknowledged by ${seen.person} at ${utc(seen.wall_ns)}; clears when normal again.`;
  if (alarm.phase === "returned") return "Normal again; clears when acknowledged.";
  return "Not acknowledged.";
}
