/** The verdicts of the last windows of all wheels in one picture: a strip for each wheel, the latest window at its right.
 *  Drawn on a canvas, wheel by wheel where something is new: a thousand wheels are 32,000 marks. */
import { h } from "./dom.js";
import { byName, counted, number, shortTime } from "./format.js";
import { last, recentWindows } from "./store.js";

const WINDOWS = 32;
const GAP = 12; // pixels between columns of wheels
// From few wheels to many: height of a strip, width of a mark, space for the wheel's name.
const SIZES = [{ row: 22, cell: 9, label: 210 }, { row: 15, cell: 5, label: 110 }, { row: 9, cell: 3, label: 0 }, { row: 5, cell: 2, label: 0 }];
const MOST_HIGH = 240; // pixels, then the next size
// Verdicts differ in height as well as in colour, and more severe anomalies are higher.
const MARKS = { nominal: [0.25, "--nominal"], inconclusive: [0.55, "--inconclusive"], anomalous: [0.8, "--anomalous"], severe: [1, "--critical"] };
const SEVERE = 1.5; // severity at which the level distress begins
const KEY = [["nominal", "nominal"], ["inconclusive", "inconclusive, or the friction model does not fit"], ["anomalous", "anomalous"], ["severe", `anomalous, severity ${SEVERE} and more`]];

const markOf = (window) => (window.verdict === "anomalous" ? (window.severity >= SEVERE ? "severe" : "anomalous") : window.verdict === "nominal" && !window.fits ? "inconclusive" : window.verdict);

/** The last windows of a wheel in words. */
export function inWords(wheel) {
  const windows = recentWindows(wheel, WINDOWS);
  const count = (verdict) => windows.filter((one) => one.verdict === verdict).length;
  const parts = ["anomalous", "inconclusive", "nominal"].filter(count).map((verdict) => `${count(verdict)} ${verdict}`);
  return windows.length ? `Of the last ${counted(windows.length, "window")}: ${parts.join(", ")}.` : "";
}

/** `open` is called with the name of the wheel that is chosen. */
export function heatStrip(open) {
  const canvas = h("canvas", { role: "img", tabindex: 0, "aria-describedby": "heat-help" });
  const box = h("div", { class: "heat" }, canvas);
  const reading = h("p", { class: "reading soft", "aria-live": "polite" });
  const element = h("section", { class: "card", "aria-label": "Last windows of all wheels" }, box, reading,
    h("div", { class: "key", id: "heat-help" }, "each wheel's last windows, the latest at the right:", KEY.map(([mark, text]) => h("span", {}, h("span", { class: `mark is-${mark}` }), ` ${text}`)), h("span", {}, "pale: not live")));
  let wheels = [], place = null, drawn = "", at = null;
  let entered = [];
  const ranks = new Map();
  const done = new Map(); // what was drawn of each wheel

  /** The place of a wheel among all names that were there; comparing names each time would take long. */
  function rankOf(name) {
    if (!ranks.has(name)) {
      const names = [...new Set([...ranks.keys(), ...entered])].sort(byName);
      names.forEach((one, i) => ranks.set(one, i));
    }
    return ranks.get(name);
  }

  function refresh(entries) {
    entered = entries.map(({ wheel }) => wheel.name);
    element.hidden = !entries.length;
    const width = box.clientWidth;
    if (element.hidden || !width) return;
    wheels = entries.map(({ wheel, state }) => ({ wheel, stale: state !== "live" })).sort((a, b) => rankOf(a.wheel.name) - rankOf(b.wheel.name));
    const style = getComputedStyle(document.documentElement);
    const now = `${width} ${devicePixelRatio} ${style.getPropertyValue("--card")} ${wheels.map(({ wheel }) => wheel.name)}`;
    if (now !== drawn) {
      drawn = now;
      done.clear();
      place = layout(width, wheels.length);
      canvas.width = width * devicePixelRatio;
      canvas.height = place.rows * place.row * devicePixelRatio;
      canvas.style.height = `${place.rows * place.row}px`;
    }
    const ink = (name) => style.getPropertyValue(name);
    let changed = false;
    wheels.forEach(({ wheel, stale }, n) => {
      const state = `${last(wheel)?.window_end_ns} ${wheel.diagnoses.length} ${wheel.earlier.length} ${stale}`;
      if (done.get(wheel.name) === state) return;
      done.set(wheel.name, state);
      drawWheel(wheel, n, stale, ink);
      changed = true;
    });
    if (changed) canvas.setAttribute("aria-label", summary());
  }

  function drawWheel(wheel, n, stale, ink) {
    const pen = canvas.getContext("2d");
    const { x, y } = corner(n);
    pen.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    pen.clearRect(x, y, place.label + WINDOWS * place.cell, place.row);
    pen.fillStyle = ink("--line"); // where no window is known, a line
    pen.fillRect(x + place.label, y + place.row - 1, WINDOWS * place.cell, 1);
    pen.globalAlpha = stale ? 0.45 : 1;
    const windows = recentWindows(wheel, WINDOWS);
    windows.forEach((one, i) => {
      const [share, colour] = MARKS[markOf(one)];
      const high = Math.max(1, share * (place.row - 2));
      pen.fillStyle = ink(colour);
      pen.fillRect(x + place.label + (WINDOWS - windows.length + i) * place.cell, y + place.row - 1 - high, place.cell - (place.cell > 3 ? 1 : 0), high);
    });
    if (!place.label) return;
    pen.globalAlpha = 1;
    pen.fillStyle = ink("--ink");
    pen.font = `${Math.min(13, place.row - 3)}px system-ui, "DejaVu Sans", sans-serif`;
    pen.textBaseline = "middle";
    const whole = `${wheel.spacecraft} / ${wheel.wheel}`;
    pen.save();
    pen.beginPath();
    pen.rect(x, y, place.label - 6, place.row);
    pen.clip();
    pen.fillText(pen.measureText(whole).width < place.label - 6 ? whole : wheel.wheel, x, y + place.row / 2);
    pen.restore();
  }

  const corner = (n) => ({ x: Math.floor(n / place.rows) * (place.label + WINDOWS * place.cell + GAP), y: (n % place.rows) * place.row });

  function summary() {
    const latest = wheels.map(({ wheel }) => last(wheel)?.verdict ?? "without a window");
    const counts = [...new Set(latest)].map((verdict) => `${latest.filter((one) => one === verdict).length} ${verdict}`);
    return `Verdicts of the last windows of ${counted(wheels.length, "wheel")}; the latest: ${counts.join(", ")}. The list below has the same.`;
  }

  /** Show in words what is at a place: wheel n, and the i-th of the windows that a strip has room for. */
  function read(n, i) {
    at = { n, i };
    const { wheel } = wheels[n];
    const windows = recentWindows(wheel, WINDOWS);
    const one = windows[i - WINDOWS + windows.length];
    reading.textContent = `${wheel.spacecraft} / ${wheel.wheel}: ${one ? `window to ${shortTime(one.end_ns)}, ${one.verdict}${one.verdict === "anomalous" ? `, severity ${number(one.severity)}` : ""}${one.fits ? "" : ", the friction model does not fit"}` : "no window known"}`;
  }

  function under(event) {
    const column = place.label + WINDOWS * place.cell + GAP;
    const n = Math.floor(event.offsetX / column) * place.rows + Math.floor(event.offsetY / place.row);
    const i = Math.floor(((event.offsetX % column) - place.label) / place.cell);
    return event.offsetY >= place.rows * place.row || !wheels[n] ? null : { n, i: Math.min(WINDOWS - 1, Math.max(0, i)) };
  }

  canvas.addEventListener("pointermove", (event) => {
    const found = under(event);
    canvas.style.cursor = found ? "pointer" : "";
    if (found) read(found.n, found.i);
  });
  canvas.addEventListener("click", (event) => { const found = under(event); if (found) open(wheels[found.n].wheel.name); });
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1], Home: [-Infinity, 0], End: [Infinity, 0] }[event.key];
    const { n, i } = at ?? { n: 0, i: WINDOWS - 1 };
    if (event.key === "Enter" && wheels[n]) open(wheels[n].wheel.name);
    if (!step || !wheels.length) return;
    event.preventDefault();
    const bound = (value, most) => Math.min(most, Math.max(0, value));
    read(at ? bound(n + step[0], wheels.length - 1) : 0, at ? bound(i + step[1], WINDOWS - 1) : WINDOWS - 1);
  });
  return { element, refresh };
}

/** The largest strips with which so many wheels fit. */
function layout(width, count) {
  let place = null;
  for (const size of SIZES) {
    const label = Math.max(0, Math.min(size.label, width - WINDOWS * size.cell)); // a phone has less
    const columns = Math.max(1, Math.floor((width + GAP) / (label + WINDOWS * size.cell + GAP)));
    const rows = Math.ceil(count / columns);
    if ((rows * size.row <= MOST_HIGH && label > size.label / 2) || size.label === 0) place = { ...size, label, rows };
    if (place && rows * size.row <= MOST_HIGH) break;
  }
  return place;
}
