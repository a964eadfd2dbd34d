/** The friction by the diagnosis, to lay beside what was measured. */

/** Friction of one switching system at a slot of its window [N m]. */
function systemFriction(sojourns, slot) {
  let now = 0;
  sojourns.start_index.forEach((start, i) => { if (slot >= start) now = sojourns.friction_Nm[i]; });
  return now;
}

/** Friction torque that opposes the rotation [N m], or null where no diagnosed window covers the time. */
export function simulated(diagnoses, timeNs, speed) {
  const window = diagnoses.findLast((one) => one.window_start_ns <= timeNs && timeNs < one.window_end_ns);
  if (!window || window.friction.base_dry.value === null || window.friction.viscous.value === null) return null;
  const slot = Math.round(((timeNs - window.window_start_ns) * window.samples) / (window.window_end_ns - window.window_start_ns));
  const dry = Object.values(window.friction.fss).reduce((sum, one) => sum + systemFriction(one, slot), window.friction.base_dry.value);
  return dry + window.friction.viscous.value * Math.abs(speed);
}

/** Mean friction of one switching system over a window [N m]. */
export function meanFriction(sojourns, samples) {
  return sojourns.start_index.reduce((sum, start, i) => sum + sojourns.friction_Nm[i] * ((sojourns.start_index[i + 1] ?? samples) - start), 0) / samples;
}
