/** How a diagnosis is shown: a sign, a colour, words. Green is for what was judged and found well, and for nothing else. */
export const SIGN = { nominal: "✓", anomalous: "▲", inconclusive: "?" };

/** Class of a diagnosis's colour: that of its verdict, but nothing is green while the friction model does not fit. */
export const colour = (diagnosis) => (diagnosis.verdict === "nominal" && !diagnosis.model_adequate ? "inconclusive" : diagnosis.verdict);

/** The note on the friction model beside the verdict; "" where it fits. */
export function misfit(diagnosis) {
  if (diagnosis.model_adequate) return "";
  return `the friction model does not fit${diagnosis.suspected_effect ? `; suspected: ${diagnosis.suspected_effect.replaceAll("_", " ")}` : ""}`;
}

/** Class and words for one part of a diagnosis. */
export function partVerdict(diagnosis, part) {
  if (part.nominal_low === null) return ["soft", "– not judged"];
  const open = diagnosis.verdict === "inconclusive" || !diagnosis.model_adequate;
  if (part.active) return diagnosis.verdict === "anomalous" ? ["anomalous", "▲ active"] : ["inconclusive", "? may be active"];
  return open ? ["inconclusive", "? open"] : ["nominal", "✓ none"];
}

/** What stands below the parts where they are not all clear or active; "" where they are. */
export function partsNote(diagnosis) {
  const parts = Object.values(diagnosis.anomalies);
  const lines = [];
  if (parts.some((part) => part.nominal_low === null)) lines.push("– not judged: no nominal range is known.");
  if (parts.some((part) => partVerdict(diagnosis, part)[0] === "inconclusive")) {
    const why = diagnosis.model_adequate ? "the verdict on this window is open" : "the friction model does not fit, so these figures are uncertain";
    lines.push(`? is neither a called anomaly nor an all-clear: ${why}.`);
  }
  return lines.join(" ");
}
