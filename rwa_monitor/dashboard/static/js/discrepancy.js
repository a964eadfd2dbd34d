/** The discrepancy report of a wheel: what its friction model lacks, how sure that is, and what knowing it gains. */
import { facts, h, table } from "./dom.js";
import { number, quantity, wheelTime, withStd } from "./format.js";

const VERDICT = { adequate: "✓ the friction model fits", inadequate: "▲ the friction model lacks something", untestable: "? not testable with this data" };
const UNIT_SUFFIX = /_(Nm|Nm_s_rad|rad_s2?|s|degC|A|V|kg_m2|per_.*)$/; // repeated by the value's unit
const words = (name) => name.replaceAll("_", " ");
const title = (parameter) => words(parameter.replace(UNIT_SUFFIX, ""));
const written = (value, unit) => (unit === "-" || unit === "" ? number(value) : quantity(value, unit));

export function discrepancyReport(found) {
  const lines = [h("p", { class: found.verdict === "inadequate" ? "inconclusive" : "soft" }, h("b", {}, VERDICT[found.verdict])),
    h("p", { class: "soft" }, `From samples of ${wheelTime(found.start_ns)} to ${wheelTime(found.end_ns)}.`)];
  if (found.effects.length) {
    const rows = found.effects.map((one) => h("tr", {},
      h("th", { scope: "row" }, words(one.name)),
      h("td", {}, Object.entries(one.parameters).map(([name, { value, std, unit }]) => h("div", {}, `${title(name)} ${withStd(value, std, (figure) => written(figure, unit))}`))),
      h("td", { class: "figure" }, number(one.p_value)),
      h("td", {}, one.equivalent.map(words).join(", ") || "–"),
      h("td", {}, one.separate_by || "–")));
    lines.push(h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Effects found" }, table(["effect", "parameters", "p-value", "indistinguishable from", "what would separate them"], rows)));
  }
  if (found.unexplained) {
    const { signature, size_Nm, nearest } = found.unexplained;
    const near = nearest ? `; ${words(nearest.effect)} comes nearest, with ${number(100 * nearest.share)} %` : "";
    lines.push(h("p", { class: "inconclusive" }, `Unexplained: ${words(signature)}, ${quantity(size_Nm, "N m")}${near}.`));
  }
  if (found.gain) lines.push(gain(found.gain));
  if (found.untested.length) {
    lines.push(h("details", {}, h("summary", {}, `Not tested (${found.untested.length})`), h("ul", {}, found.untested.map((one) => h("li", {}, `${words(one.effect)}: ${one.missing}`)))));
  }
  return lines;
}

function gain(one) {
  const gains = [
    ["residual on held-out data", `${quantity(one.rmse_base_Nm, "N m")} → ${quantity(one.rmse_extended_Nm, "N m")}`],
    ["log score", `${number(one.log_score_base)} → ${number(one.log_score_extended)} a sample`],
    ["jumps", `${one.changepoints_base} → ${one.changepoints_extended}`],
  ];
  const rate = (name) => `${number(one.diagnosis.before[name])} → ${number(one.diagnosis.after[name])}`;
  if (one.diagnosis) gains.push(["detection", rate("detection")], ["false positives", rate("false_positive")]);
  return h("div", {}, h("h3", {}, "What the extended model gains"), h("dl", {}, facts(gains)));
}
