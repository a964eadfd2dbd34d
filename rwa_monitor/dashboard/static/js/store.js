import { LEVELS } from "./levels.js";

export const REPLAY = "@replay"; // what the name of a wheel ends with whose telemetry is only played again
const STORED_ALARM = " (stored)";

/** Whether an alarm is of stored telemetry: it is of earlier, and says nothing of now. */
export const isStored = (alarm) => alarm.name.endsWith(STORED_ALARM);

/** What a wheel's telemetry is where it is not live: of its latest window, or of a replay; "" where it is live. */
export const dataOf = (wheel, diagnosis) => (wheel.wheel.endsWith(REPLAY) ? "replay: a recording that is played again" : diagnosis?.data ? "stored data: measured earlier, not live" : "");

/** What is known of the fleet, from the entries of the feed. Live and replay each have one, and nothing else differs. */
const MAX_WINDOWS = 1000;
const MAX_POINTS = 12000;
const SILENT_MS = 6000; // the monitor reports every second

export const noSamples = () => ({ t: [], speed: [], friction: [], temperature: [] });

export class Store {
  constructor(live) {
    this.live = live;
    this.wheels = new Map();
    this.alarms = new Map();
    this.retirements = new Map(); // the last audit event of each wheel that was ever retired
    this.worst = null; // open alarm of each wheel, of the second worstOf
    this.now = 0; // time of the source, ms
  }

  wheel(name) {
    if (!this.wheels.has(name)) {
      const [spacecraft, wheel] = name.split("/");
      this.wheels.set(name, { name, spacecraft, wheel, version: 0, diagnoses: [], status: null, reported: null, fill: 0, telemetry: null, refused: null, verdicts: null, discrepancy: null, jumps: [], earlier: [], ...noSamples() });
    }
    return this.wheels.get(name);
  }

  apply(entry) {
    const parts = entry.key.split("/");
    if (parts[0] !== "rwa" || parts.length !== 4) return;
    const message = entry.message;
    if (parts[3] === "alarm") {
      this.alarms.set(message.id, message);
      this.worst = null;
      if (message.closed_ns === null) this.wheel(`${parts[1]}/${parts[2]}`); // a wheel without a monitor has nothing else
      return;
    }
    if (parts[3] === "retirement") {
      this.retirements.set(`${parts[1]}/${parts[2]}`, message);
      this.worst = null;
      return;
    }
    const wheel = this.wheel(`${parts[1]}/${parts[2]}`);
    wheel.version += 1;
    // What comes out of the history or a bus's memory is not of now: only a status shows a live monitor.
    if (parts[3] === "status") {
      wheel.status = message;
      const refused = message.messages_rejected && !message.samples_received ? message.last_error : null;
      this.report(wheel, entry.received_wall_ns, message.window_fill, entry.beside, refused);
    } else if (parts[3] === "diagnosis") {
      this.addDiagnosis(wheel, message);
      if (entry.beside) wheel.verdicts = entry.beside;
    } else if (parts[3] === "changepoints") wheel.jumps.push(...message.changepoints);
    else if (parts[3] === "samples") this.addSamples(wheel, message);
    else if (parts[3] === "discrepancy") wheel.discrepancy = message;
  }

  /** What the statuses of wheels come to that this page does not look at. */
  pulse(wheels) {
    for (const [name, beat] of Object.entries(wheels)) this.report(this.wheel(name), beat.reported_wall_ns, beat.window_fill, beat.telemetry, beat.refused);
  }

  report(wheel, wallNs, fill, telemetry, refused) {
    wheel.version += 1;
    wheel.reported = wallNs / 1e6;
    wheel.fill = fill;
    wheel.telemetry = telemetry;
    wheel.refused = refused;
  }

  addDiagnosis(wheel, message) {
    const known = wheel.diagnoses;
    if (wheel.wheel.endsWith(REPLAY) && message.window_end_ns < (last(wheel)?.window_end_ns ?? 0) && !message.data) { // it begins from the start
      known.length = wheel.earlier.length = 0;
      Object.assign(wheel, noSamples());
    }
    const same = known.findIndex((other) => other.window_start_ns === message.window_start_ns);
    if (same >= 0) known[same] = message;
    else {
      known.push(message);
      known.sort((a, b) => a.window_start_ns - b.window_start_ns);
      if (known.length > MAX_WINDOWS) known.shift();
      wheel.jumps = wheel.jumps.filter((jump) => jump.time_ns >= message.window_end_ns);
    }
  }

  addSamples(wheel, message) {
    if (!message) return;
    const last = wheel.t.length ? wheel.t[wheel.t.length - 1] : -Infinity;
    message.time_ns.forEach((time, i) => {
      if (time / 1e9 <= last) return;
      wheel.t.push(time / 1e9);
      wheel.speed.push(message.speed_rad_s[i]);
      wheel.friction.push(message.friction_torque_Nm?.[i] ?? null);
      wheel.temperature.push(message.bearing_temperature_degC?.[i] ?? null);
    });
    const over = wheel.t.length - MAX_POINTS;
    if (over > 0) for (const name of Object.keys(noSamples())) wheel[name].splice(0, over);
  }

  /** Put samples before those that are there, of a time in which this page got none. */
  addEarlierSamples(wheel, message) {
    const later = { t: wheel.t, speed: wheel.speed, friction: wheel.friction, temperature: wheel.temperature };
    Object.assign(wheel, noSamples());
    this.addSamples(wheel, message);
    const end = wheel.t[wheel.t.length - 1] ?? -Infinity;
    const from = later.t.findIndex((time) => time > end);
    if (from >= 0) for (const [name, values] of Object.entries(later)) wheel[name].push(...values.slice(from));
  }

  /** Take in the verdicts of earlier windows of all wheels, as the API gives them. */
  addVerdicts(found) {
    for (const [name, one] of Object.entries(found)) {
      const wheel = this.wheel(name);
      wheel.version += 1;
      wheel.earlier = one.window_end_ns.map((end_ns, i) => ({ end_ns, verdict: one.verdict[i], fits: one.model_adequate[i], severity: one.severity[i] }));
    }
  }

  /** Whether the state of a wheel is of now: "live", "silent" (its monitor does not report), "recorded" (it never did,
   *  all is from the history), "unserved" (it never did, and there is nothing), or "starved" (the monitor lives, and gets
   *  no samples). */
  state(wheel) {
    if (!this.live) return "live";
    if (wheel.reported === null) return wheel.diagnoses.length ? "recorded" : "unserved";
    if (this.now - wheel.reported > SILENT_MS) return "silent";
    return this.starvedFor(wheel) > (wheel.telemetry?.stale_after_s ?? Infinity) ? "starved" : "live";
  }

  /** Seconds since the last samples of a wheel came. */
  starvedFor(wheel) {
    return wheel.telemetry?.wall_ns == null ? 0 : this.now / 1e3 - wheel.telemetry.wall_ns / 1e9;
  }

  /** The open live alarm of a wheel with the highest level, null where it has none or all are shelved. */
  worstAlarm(name) {
    const second = Math.floor(this.now / 1000);
    if (this.worst === null || this.worstOf !== second) {
      this.worst = new Map();
      this.worstOf = second;
      for (const alarm of this.openAlarms()) {
        if ((alarm.shelved_until_wall_ns ?? 0) / 1e6 > this.now || isStored(alarm)) continue;
        const of = `${alarm.spacecraft}/${alarm.wheel}`;
        const known = this.worst.get(of);
        if (!known || LEVELS.indexOf(alarm.level) > LEVELS.indexOf(known.level)) this.worst.set(of, alarm);
      }
    }
    return this.worst.get(name) ?? null;
  }

  isRetired(name) {
    return this.retirements.get(name)?.event === "retired";
  }

  /** The open alarms of all wheels but the retired ones. */
  openAlarms() {
    return [...this.alarms.values()].filter((alarm) => alarm.closed_ns === null && !this.isRetired(`${alarm.spacecraft}/${alarm.wheel}`));
  }
}

/** End, verdict, fit of the model and worst severity of the latest windows of a wheel, at most so many, the oldest first. */
export function recentWindows(wheel, most) {
  const own = wheel.diagnoses.slice(-most).map((one) => ({ end_ns: one.window_end_ns, verdict: one.verdict, fits: one.model_adequate, severity: worstSeverity(one) }));
  const from = own[0]?.end_ns ?? Infinity;
  // A page has all windows since it was opened, and of those before perhaps the latest only.
  const between = wheel.earlier.filter((one) => one.end_ns < from || !own.some((other) => other.end_ns === one.end_ns));
  return [...between, ...own].sort((a, b) => a.end_ns - b.end_ns).slice(-most);
}

/** The highest severity among the active anomalies of a diagnosis that calls some; 0 for none. */
export function worstSeverity(diagnosis) {
  if (diagnosis?.verdict !== "anomalous") return 0;
  return Math.max(0, ...Object.values(diagnosis.anomalies).map((anomaly) => (anomaly.active ? anomaly.severity ?? 0 : 0)));
}

export const last = (wheel) => wheel.diagnoses[wheel.diagnoses.length - 1] ?? null;
