/** Levels of alarms, the least first, and how they are shown: never by colour alone. */
export const LEVELS = ["normal", "watch", "warning", "distress", "critical"];
export const MARK = { watch: "○ watch", warning: "◐ warning", distress: "● distress", critical: "⬤ critical", normal: "✓ normal again" };
