/** Charts on uPlot: units on every axis, UTC below, colours that colour-blind people tell apart, shapes beside them. */
import { h } from "./dom.js";

const COLOURS = ["#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const GREY = "#8593a0";

/** Colour and shape of the n-th switching system; rejected and unattributed jumps are grey. */
export function systemStyle(name, systems) {
  const n = systems.indexOf(name);
  return n < 0 ? { colour: GREY, shape: name === "rejected" ? "×" : "◇" } : { colour: COLOURS[n % COLOURS.length], shape: ["▲", "■", "●", "◆", "▼", "★"][n % 6] };
}

const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** A chart that follows the width of its place. `series`: {label, colour, points, width, fill, paths, dash}. */
export function chart({ label, unit, series, height = 210, draw, zero = false }) {
  const place = h("div", { class: "chart", role: "img", "aria-label": `${label} [${unit}] over time` });
  let plot = null;
  let wide = 0;
  function make(data) {
    plot?.destroy();
    wide = place.clientWidth;
    const axis = { stroke: ink("--soft"), grid: { stroke: ink("--line"), width: 1 }, ticks: { stroke: ink("--line") } };
    plot = new uPlot({
      width: wide, height, tzDate: (s) => uPlot.tzDate(new Date(s * 1e3), "Etc/UTC"), legend: { show: false }, cursor: { drag: { x: true, y: false } },
      scales: { y: zero ? { range: (u, low, high) => [Math.min(0, low), (high || 1) * 1.05] } : {} },
      axes: [{ ...axis, label: "time [UTC]", labelSize: 18, size: 34, values: clockTicks }, { ...axis, size: 68, label: `${label} [${unit}]`, labelSize: 18, values: (u, ticks) => ticks.map((tick) => String(Number(tick.toPrecision(4)))) }],
      series: [{}, ...series.map((one) => ({ label: one.label, stroke: one.colour, width: one.width ?? 1.5, dash: one.dash, fill: one.fill, paths: one.paths, points: { show: one.points ?? false, size: one.size ?? 3, fill: one.colour } }))],
      hooks: draw ? { draw: [draw] } : {},
    }, data, place);
  }
  return {
    element: place,
    set(data) {
      if (!place.clientWidth) return;
      if (!plot || place.clientWidth !== wide) make(data);
      else plot.setData(data);
    },
    close: () => plot?.destroy(),
  };
}

/** Hours and minutes, with the date where it begins, or days where the ticks are days apart. */
function clockTicks(u, ticks) {
  const texts = ticks.map((s) => new Date(s * 1e3).toISOString());
  const days = ticks.length > 1 && ticks[1] - ticks[0] >= 86400;
  return texts.map((text, i) => (days || (i && text.slice(0, 10) !== texts[i - 1].slice(0, 10)) ? text.slice(5, 10) : text.slice(11, ticks[1] - ticks[0] < 60 ? 19 : 16)));
}

/** Write marks, such as ▲, at (x, y) of a chart. */
export function marks(u, entries) {
  const { ctx } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
  ctx.clip();
  ctx.font = `${14 * devicePixelRatio}px sans-serif`;
  ctx.textAlign = "center";
  for (const { x, shape, colour } of entries) {
    const at = u.valToPos(x, "x", true);
    ctx.strokeStyle = ctx.fillStyle = colour;
    ctx.setLineDash([4, 4]);
    ctx.beginPath();
    ctx.moveTo(at, u.bbox.top + 18 * devicePixelRatio);
    ctx.lineTo(at, u.bbox.top + u.bbox.height);
    ctx.stroke();
    ctx.fillText(shape, at, u.bbox.top + 14 * devicePixelRatio);
  }
  ctx.restore();
}

/** Shade the range that is nominal. */
export function band(u, low, high) {
  if (low === null || high === null) return;
  const { ctx } = u;
  const top = Math.max(u.valToPos(high, "y", true), u.bbox.top);
  const bottom = Math.min(u.valToPos(low, "y", true), u.bbox.top + u.bbox.height);
  ctx.save();
  ctx.fillStyle = "rgba(0, 158, 115, .18)";
  if (bottom > top) ctx.fillRect(u.bbox.left, top, u.bbox.width, bottom - top);
  ctx.restore();
}

export { COLOURS, GREY };
