/** Charts on uPlot: units on every axis, UTC below, colours that colour-blind people can distinguish, shapes beside them. */
import { h } from "./dom.js";
import { tellsUtc, wheelTime } from "./format.js";

const COLOURS = ["#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const GREY = "#8593a0";

/** Colour and shape of the n-th switching system; rejected and unattributed jumps are grey. */
export function systemStyle(name, systems) {
  const n = systems.indexOf(name);
  return n < 0 ? { colour: GREY, shape: name === "rejected" ? "×" : "◇" } : { colour: COLOURS[n % COLOURS.length], shape: ["▲", "■", "●", "◆", "▼", "★"][n % 6] };
}

const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** A chart that follows the width of its place and the page's colours.
 *  `series`: {label, colour, points, width, fill, paths, dash, steps}; `bands`: [upper, lower, colour] by series number;
 *  `sync`: charts with the same word share cursor and zoom;
 *  `over`: {label, unit} of what the x-axis is, where it is not time. */
export function chart({ label, unit, series, height = 210, draw, zero = false, bands = [], sync, over }) {
  const place = h("div", { class: "chart", role: "img", "aria-label": `${label}${unit ? ` [${unit}]` : ""} over ${over?.label ?? "time"}` });
  const reading = h("p", { class: "reading soft" }, " ");
  let plot = null;
  let made = "";
  function make(data) {
    plot?.destroy();
    const axis = { stroke: ink("--soft"), grid: { stroke: ink("--line"), width: 1 }, ticks: { stroke: ink("--line") } };
    const clock = over ? `${over.label} [${over.unit}]` : !data[0].length || tellsUtc(data[0][0] * 1e9) ? "time [UTC]" : "spacecraft clock [s]";
    const drawn = (one) => ({
      label: one.label, stroke: one.colour, width: one.width ?? 1.5, dash: one.dash, fill: one.fill,
      paths: one.paths ?? (one.steps ? uPlot.paths.stepped({ align: -1 }) : undefined),
      points: { show: one.points ?? false, size: one.size ?? 3, fill: one.colour },
    });
    plot = new uPlot({
      width: place.clientWidth, height, tzDate: (s) => uPlot.tzDate(new Date(s * 1e3), "Etc/UTC"), legend: { show: false },
      cursor: { drag: { x: true, y: false }, sync: sync ? { key: sync, scales: ["x", null] } : undefined },
      scales: { x: { time: !over }, y: zero ? { range: (u, low, high) => [Math.min(0, low), (high || 1) * 1.05] } : {} },
      axes: [{ ...axis, label: clock, labelSize: 18, size: 34, space: 75, values: over ? plainTicks : clockTicks }, { ...axis, size: 68, label: unit ? `${label} [${unit}]` : label, labelSize: 18, values: plainTicks }],
      series: [{}, ...series.map(drawn)],
      bands: bands.map(([upper, lower, fill]) => ({ series: [upper, lower], fill })),
      hooks: { draw: draw ? [draw] : [], setCursor: [(u) => read(u, series, unit, reading, over)] },
    }, data, place);
  }
  return {
    element: h("div", {}, place, reading),
    set(data) {
      if (!place.clientWidth) return;
      const now = `${place.clientWidth} ${ink("--card")} ${data[0].length > 0}`;
      if (!plot || now !== made) make(data);
      else plot.setData(data, !zoomed(plot));
      made = now;
    },
    get width() { return place.clientWidth; },
    close: () => plot?.destroy(),
  };
}

/** Whether somebody has zoomed in: new data then does not move what they look at. Two clicks zoom out again. */
function zoomed(u) {
  const times = u.data[0];
  return times.length > 1 && (u.scales.x.min > times[0] || u.scales.x.max < times[times.length - 1]);
}

/** Below a chart: time, on both clocks, and values at the cursor. */
function read(u, series, unit, reading, over) {
  const i = u.cursor.idx;
  const time = i === null || i === undefined ? undefined : u.data[0][i];
  const values = time === undefined ? [] : series.map((one, n) => [one.label, u.data[n + 1][i]]).filter(([, value]) => value !== null && value !== undefined);
  const at = over && time !== undefined ? `${over.label} ${Number(time.toPrecision(4))} ${over.unit}` : time === undefined ? "" : wheelTime(time * 1e9);
  reading.textContent = time === undefined ? " " : `${at}: ${values.map(([label, value]) => `${label} ${Number(value.toPrecision(4))} ${unit ?? ""}`).join(", ")}`;
}

const plainTicks = (u, ticks) => ticks.map((tick) => (tick === null ? "" : String(Number(tick.toPrecision(4)))));

/** Hours and minutes, with the date where it begins, or days where the ticks are days apart; seconds of a clock that
 *  gives no UTC. */
function clockTicks(u, ticks) {
  if (ticks.length && !tellsUtc(ticks[0] * 1e9)) return ticks.map((s) => String(s));
  const texts = ticks.map((s) => new Date(s * 1e3).toISOString());
  const days = ticks.length > 1 && ticks[1] - ticks[0] >= 86400;
  return texts.map((text, i) => (days || (i && text.slice(0, 10) !== texts[i - 1].slice(0, 10)) ? text.slice(5, 10) : text.slice(11, ticks[1] - ticks[0] < 60 ? 19 : 16)));
}

/** Draw inside a chart's frame. */
function inFrame(u, paint) {
  const { ctx } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
  ctx.clip();
  paint(ctx);
  ctx.restore();
}

/** Mark times by a dashed line and a sign on top of it. */
export function marks(u, entries) {
  inFrame(u, (ctx) => {
    ctx.font = `${14 * devicePixelRatio}px sans-serif`;
    ctx.textAlign = "center";
    ctx.setLineDash([4, 4]);
    for (const { x, shape, colour } of entries) {
      const at = u.valToPos(x, "x", true);
      ctx.strokeStyle = ctx.fillStyle = colour;
      ctx.beginPath();
      ctx.moveTo(at, u.bbox.top + 18 * devicePixelRatio);
      ctx.lineTo(at, u.bbox.top + u.bbox.height);
      ctx.stroke();
      ctx.fillText(shape, at, u.bbox.top + 14 * devicePixelRatio);
    }
  });
}

export { COLOURS, GREY, ink };
