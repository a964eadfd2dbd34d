/** What the keys do, and the list of them that "?" opens. */
import { h } from "./dom.js";

const VIEWS = { f: ["#/", "fleet"], a: ["#/alarms", "alarms"], r: ["#/recordings", "recordings"] };
const search = () => document.querySelector("input[type=search]");
const MORE = [
  ["/", "search wheels, in the fleet"], ["d", "dark, light, or as the system has it"], ["?", "this list; Esc closes it"],
  ["Tab, Enter", "to the next link or field, and into it"],
  ["← → ↑ ↓, Home, End", "in the picture of last windows: from window to window and wheel to wheel; Enter opens the wheel"],
];

export function keys() {
  const close = h("button", { type: "button", onclick: () => help.close() }, "Close");
  const help = h("dialog", { "aria-labelledby": "keys-title" }, h("h2", { id: "keys-title" }, "Keys"),
    h("dl", {}, [...Object.entries(VIEWS).map(([key, [, text]]) => [key, text]), ...MORE].flatMap(([key, text]) => [h("dt", {}, h("kbd", {}, key)), h("dd", {}, text)])), close);
  document.body.append(help);
  const open = () => { if (!help.open) help.showModal(); };
  document.getElementById("keys").addEventListener("click", open);
  addEventListener("keydown", (event) => {
    if (help.open || event.target.matches("input, select, textarea") || event.ctrlKey || event.metaKey || event.altKey) return;
    if (VIEWS[event.key]) [location.hash] = VIEWS[event.key];
    if (event.key === "?") open();
    if (event.key === "d") document.getElementById("theme").click();
    if (event.key === "/" && search()) { event.preventDefault(); search().focus(); }
  });
}
