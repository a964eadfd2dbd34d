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

/** Dry friction of a window by its diagnosis [N m], base and switching systems, with times [s]: where no sample is known. */
export function dryFriction(window) {
  const step = (window.window_end_ns - window.window_start_ns) / window.samples;
  const slots = [...new Set([0, window.samples - 1, ...Object.values(window.friction.fss).flatMap((one) => one.start_index.flatMap((start) => [start - 1, start]))])].filter((slot) => slot >= 0).sort((a, b) => a - b);
  const times = slots.map((slot) => window.window_start_ns + (slot + 0.5) * step);
  return [times.map((ns) => ns / 1e9), times.map((ns) => simulated([window], ns, 0))];
}
