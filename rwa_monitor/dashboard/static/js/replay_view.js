import { ask } from "./ask.js";
import { h } from "./dom.js";
import { fleetView } from "./fleet_view.js";
import { number, shortTime, tellsUtc, utc, wheelTime } from "./format.js";
import { Store } from "./store.js";
import { wheelView } from "./wheel_view.js";

const FRAME_MS = 100;
const SECOND_NS = 1e9; // in which times are written in the field
const SPEEDS = [0.1, 1, 10, 100, 1000, 10000, 100000]; // times real time
const UNBOUNDED = "max";
const WORK_MS = 50; // of each frame, where it goes as fast as it can
let opened = null; // the recording that is open, kept while views change

export function recordingsView() {
  const list = h("div", {}, h("p", { class: "empty" }, "Loading…"));
  const goTo = timeField((time) => {
    const found = recordings.find((one) => one.first_ns !== null && one.first_ns - SECOND_NS < time && time <= one.last_ns);
    if (found) location.hash = `#/replay/${encodeURIComponent(found.name)}/at/${time}`;
    return found ? "" : `No recording covers ${shortTime(time)}.`;
  });
  let recordings = [];
  ask("/api/recordings").then((found) => {
    recordings = found;
    goTo.element.hidden = !found.some((one) => one.first_ns !== null);
    goTo.use(found.find((one) => one.first_ns !== null)?.first_ns ?? 0);
    list.replaceChildren(...(found.length ? found.map((one) => h("p", { class: "card" }, h("a", { href: `#/replay/${encodeURIComponent(one.name)}` }, one.name), h("span", {}, ` ${times(one)}`), h("span", { class: "soft" }, ` ${number(one.size_bytes / 1e6)} MB, written ${utc(one.changed_wall_ns)}`))) : [h("p", { class: "empty" }, "No recording in this folder yet. A monitor writes them with --record.")]));
  },
    (error) => list.replaceChildren(h("p", { class: "anomalous", role: "alert" }, `Recordings cannot be listed: ${error.message}`)));
  return { element: h("div", {}, h("h1", {}, "Recordings"), goTo.element, list), refresh() {} };
}

/** The time that a recording covers, on the wheels' clocks; "" where none is known. */
const times = (one) => (one.first_ns === null ? "" : `${shortTime(one.first_ns)} to ${shortTime(one.last_ns)}`);

/** A field for a time, written as the page shows it: in UTC where the clock gives it, else in seconds. `go` goes there,
 *  and returns what is wrong. */
function timeField(go) {
  const field = h("input", { required: true, "aria-label": "Go to", spellcheck: "false", size: 20 });
  const unit = h("span", { class: "soft" });
  const problem = h("span", { role: "status", class: "inconclusive" });
  let utcClock = true, example = "";
  const element = h("form", { class: "row", hidden: true, onsubmit: (event) => {
    event.preventDefault();
    const written = field.value.trim().replace(/ ?(UTC|Z)$/, "");
    const utcTime = written.length > 10 ? `${written.replace(" ", "T")}Z` : written; // of a date alone, its beginning
    const time = utcClock ? Date.parse(utcTime) * 1e6 : Number(written) * SECOND_NS;
    problem.textContent = Number.isFinite(time) ? go(time) : `That is no time such as ${example}.`;
  } }, h("label", {}, "Go to ", field), unit, h("button", {}, "Go"), problem);

  /** Take the first time there is: it shows the kind of clock, and where to begin. */
  function use(first) {
    utcClock = tellsUtc(first);
    field.value = example = utcClock ? utc(first).slice(0, 19) : (first / SECOND_NS).toFixed(0);
    unit.textContent = utcClock ? "UTC" : "s of the spacecraft clock";
  }

  return { element, use };
}

/** Plays a recording into a store of its own; the views are those of the live page. */
export function replayView(name, rest) {
  const place = h("div", {}, h("p", { class: "empty" }, "Opening the recording…"));
  const seek = h("input", { type: "range", min: 0, max: 1000, value: 0, "aria-label": "Position in the recording" });
  const play = h("button", { type: "button", onclick: () => toggle() }, "▶ Play");
  const step = h("button", { type: "button", onclick: () => nextWindow() }, "Next window");
  const speed = h("select", { "aria-label": "Speed" }, SPEEDS.map((times) => h("option", { value: times, selected: times === 1000 }, `${times}×`)), h("option", { value: UNBOUNDED }, "as fast as it goes"));
  const goTo = timeField((time) => {
    move(Math.min(player.end, Math.max(player.begin, time)));
    return Math.abs(player.now - time) < SECOND_NS ? "" : `It goes from ${shortTime(player.begin)} to ${shortTime(player.end)}.`;
  });
  const clock = h("span", { class: "soft" });
  const problems = h("p", { class: "inconclusive", hidden: true });
  const controls = [seek, play, step, speed];
  let player = null, inner = null, timer = null;
  for (const one of controls) one.disabled = true; // until there is something to play
  seek.addEventListener("input", () => move(player.begin + (seek.value / 1000) * (player.end - player.begin)));

  open();
  async function open() {
    try {
      if (opened?.name !== name) opened = new Player(name, await ask(`/api/recordings/${encodeURIComponent(name)}`));
      player = opened;
      for (const one of controls) one.disabled = false;
      if (rest[0] === "at") player.moveTo(Math.min(player.end, Math.max(player.begin, Number(rest[1]))));
      goTo.use(player.now);
      goTo.element.hidden = false;
      if (player.problems.length) { problems.hidden = false; problems.textContent = `Not all could be read: ${player.problems.join("; ")}`; }
      show();
    } catch (error) {
      place.replaceChildren(h("p", { class: "anomalous", role: "alert" }, `The recording cannot be opened: ${error.message}`));
    }
  }

  function show() {
    inner?.close?.();
    const base = `#/replay/${encodeURIComponent(name)}`;
    inner = rest[0] === "wheel" ? wheelView(player.store, `${rest[1]}/${rest[2]}`, base) : fleetView(player.store, base);
    place.replaceChildren(inner.element);
    draw();
  }

  function draw() {
    inner?.refresh();
    clock.textContent = wheelTime(player.now);
    seek.value = (1000 * (player.now - player.begin)) / Math.max(1, player.end - player.begin);
  }

  function move(time) {
    if (player.moveTo(time)) show();
    else draw();
  }

  function toggle() {
    clearInterval(timer);
    timer = timer ? null : setInterval(() => {
      move(speed.value === UNBOUNDED ? player.reachable(WORK_MS) : Math.min(player.end, player.now + FRAME_MS * 1e6 * Number(speed.value)));
      if (player.now >= player.end) toggle();
    }, FRAME_MS);
    play.textContent = timer ? "❚❚ Pause" : "▶ Play";
  }

  function nextWindow() {
    const next = player.entries.find((entry) => entry.time_ns > player.now && entry.key.endsWith("/diagnosis"));
    move(next ? next.time_ns : player.end);
  }

  const element = h("div", {}, h("section", { class: "card" }, h("h2", {}, `Replay of ${name}`), problems, h("div", { class: "row" }, play, step, speed, seek), clock, goTo.element), place);
  return { element, refresh: () => inner?.refresh(), close: () => { clearInterval(timer); inner?.close?.(); } };
}

class Player {
  constructor(name, content) {
    this.name = name;
    this.problems = content.problems;
    this.entries = content.entries;
    this.begin = this.entries.find((entry) => entry.time_ns > 0)?.time_ns ?? 0;
    this.end = this.entries[this.entries.length - 1]?.time_ns ?? 0;
    this.reset();
  }

  reset() {
    this.store = new Store(false);
    this.next = 0;
    this.now = this.begin;
  }

  /** The time up to which so many milliseconds of work come; that work is done. */
  reachable(workMs) {
    const due = performance.now() + workMs;
    while (this.next < this.entries.length && performance.now() < due) this.store.apply(this.entries[this.next++]);
    return this.next < this.entries.length ? Math.max(this.now, this.entries[this.next - 1]?.time_ns ?? 0) : this.end;
  }

  /** Bring the store to a time; true where it had to begin anew, because the time lies before. */
  moveTo(time) {
    const back = time < this.now;
    if (back) this.reset();
    while (this.next < this.entries.length && this.entries[this.next].time_ns <= time) this.store.apply(this.entries[this.next++]);
    this.now = time;
    return back;
  }
}
