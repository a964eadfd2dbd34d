/** The discrepancy report of a wheel: what its friction model lacks, how sure that is, and what knowing it gains. */
import { h } from "./dom.js";
import { number, quantity, wheelTime } from "./format.js";

const VERDICT = { adequate: "✓ the friction model fits", inadequate: "▲ the friction model lacks something", untestable: "? this data cannot tell" };
const words = (name) => name.replaceAll("_", " ");

export function discrepancyReport(found) {
  const lines = [h("p", { class: found.verdict === "inadequate" ? "inconclusive" : "soft" }, h("b", {}, VERDICT[found.verdict])),
    h("p", { class: "soft" }, `From samples of ${wheelTime(found.start_ns)} to ${wheelTime(found.end_ns)}.`)];
  if (found.effects.length) {
    lines.push(h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Effects found" }, h("table", {},
      h("thead", {}, h("tr", {}, ["effect", "parameters", "p-value", "cannot be told from", "what would tell"].map((text) => h("th", { scope: "col" }, text)))),
      h("tbody", {}, found.effects.map((one) => h("tr", {},
        h("th", { scope: "row" }, words(one.name)),
        h("td", {}, Object.entries(one.parameters).map(([name, value]) => h("div", {}, `${words(name)} ${quantity(value.value, value.unit)}${value.std === null ? "" : ` ± ${quantity(value.std, value.unit)}`}`))),
        h("td", {}, number(one.p_value)),
        h("td", {}, one.equivalent.map(words).join(", ") || "–"),
        h("td", {}, one.separate_by || "–")))))));
  }
  if (found.unexplained) lines.push(h("p", { class: "inconclusive" }, `Unexplained: ${words(found.unexplained.signature)}, ${quantity(found.unexplained.size_Nm, "N m")}.`));
  if (found.gain) lines.push(gain(found.gain));
  if (found.untested.length) {
    lines.push(h("details", {}, h("summary", {}, `Not tested (${found.untested.length})`), h("ul", {}, found.untested.map((one) => h("li", {}, `${words(one.effect)}: ${one.missing}`)))));
  }
  return lines;
}

function gain(one) {
  const facts = [
    ["residual on held-out data", `${quantity(one.rmse_base_Nm, "N m")} → ${quantity(one.rmse_extended_Nm, "N m")}`],
    ["log score", `${number(one.log_score_base)} → ${number(one.log_score_extended)} a sample`],
    ["jumps", `${one.changepoints_base} → ${one.changepoints_extended}`],
  ];
  if (one.diagnosis) facts.push(["detection", `${number(one.diagnosis.before.detection)} → ${number(one.diagnosis.after.detection)}`], ["false positives", `${number(one.diagnosis.before.false_positive)} → ${number(one.diagnosis.after.false_positive)}`]);
  return h("div", {}, h("h3", {}, "What the extended model gains"), h("dl", {}, facts.flatMap(([what, value]) => [h("dt", { class: "soft" }, what), h("dd", {}, value)])));
}
