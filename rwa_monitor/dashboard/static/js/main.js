import { alarmsView, shelved } from "./alarms_view.js";
import { Feed } from "./feed.js";
import { fleetView } from "./fleet_view.js";
import { age, utc } from "./format.js";
import { keys } from "./keys.js";
import { recordingsView, replayView } from "./replay_view.js";
import { Store } from "./store.js";
import { takeToken } from "./token.js";
import { visits } from "./visits.js";
import { wheelView } from "./wheel_view.js";

const REDRAW_MS = 250;
const element = (id) => document.getElementById(id);

takeToken();
const store = new Store(true);
let view = null;
let due = false;
const visit = visits(store);
const feed = new Feed(store, redrawSoon, () => view?.refill?.());

function route() {
  view?.close?.();
  const parts = location.hash.replace(/^#\/?/, "").split("/").map(decodeURIComponent);
  feed.watch("");
  if (parts[0] === "wheel" && parts.length === 3) {
    const name = `${parts[1]}/${parts[2]}`;
    feed.watch(name);
    view = wheelView(store, name, "#");
  } else if (parts[0] === "alarms") view = alarmsView(store);
  else if (parts[0] === "recordings") view = recordingsView();
  else if (parts[0] === "replay") view = replayView(parts[1], parts.slice(2));
  else view = fleetView(store, "#", visit);
  const at = { alarms: "alarms", recordings: "recordings", replay: "recordings" }[parts[0]] ?? "";
  for (const link of document.querySelectorAll("nav a")) {
    if (link.hash === `#/${at}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  element("view").replaceChildren(view.element);
  view.refresh();
}

function redrawSoon() {
  if (due) return;
  due = true;
  setTimeout(() => { due = false; redraw(); }, REDRAW_MS);
}

function redraw() {
  document.body.classList.toggle("disconnected", !feed.connected);
  element("connection").textContent = feed.connected ? "● connected" : "○ disconnected";
  element("clock").textContent = utc(Date.now() * 1e6);
  element("connection").className = feed.connected ? "" : "anomalous";
  const trouble = feed.connected ? feed.notes.join(" ") : `Disconnected from the dashboard's server. What you see is the last known state, ${age(Date.now() - feed.since)}. Trying again…`;
  element("banner").hidden = !trouble;
  if (element("banner").textContent !== trouble) element("banner").textContent = trouble;
  const waiting = store.openAlarms().filter((alarm) => alarm.phase !== "acknowledged" && !shelved(alarm, store.now)).length;
  element("alarm-count").textContent = waiting ? `(${waiting})` : "";
  document.title = `${waiting ? `(${waiting}) ` : ""}rwa-monitor`;
  view?.refresh();
}

addEventListener("hashchange", route);
keys();
setInterval(() => {
  if (!feed.connected) store.now = Date.now(); // what is known gets older also while the server does not send the time
  redraw();
}, 1000);
addEventListener("themechange", redraw);
route();
