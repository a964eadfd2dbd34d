import { h } from "./dom.js";

/** Levels of alarms, the least first, and how they are shown: by word, shape and fill, never by colour alone. */
export const LEVELS = ["normal", "watch", "warning", "distress", "critical"];
const MARK = { watch: "○ watch", warning: "◐ warning", distress: "● distress", critical: "■ critical", normal: "✓ normal again" };

/** A level as a badge. */
export const badge = (level) => h("span", { class: `level is-${level}` }, MARK[level]);
