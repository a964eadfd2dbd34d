/** What is known of the fleet, from the entries of the feed. Live and replay each have one, and nothing else differs. */
const MAX_WINDOWS = 1000;
const MAX_POINTS = 12000;
const SILENT_MS = 6000; // the monitor speaks every second

export class Store {
  constructor(live) {
    this.live = live;
    this.wheels = new Map();
    this.alarms = new Map();
    this.now = 0; // time of the source, ms
    this.changed = new Set();
  }

  wheel(name) {
    if (!this.wheels.has(name)) {
      const [spacecraft, wheel] = name.split("/");
      this.wheels.set(name, { name, spacecraft, wheel, diagnoses: [], status: null, heard: null, jumps: [], t: [], speed: [], friction: [] });
    }
    return this.wheels.get(name);
  }

  apply(entry) {
    const parts = entry.key.split("/");
    if (parts[0] !== "rwa" || parts.length !== 4) return;
    const name = `${parts[1]}/${parts[2]}`;
    const message = entry.message;
    this.changed.add(name);
    if (parts[3] === "alarm") {
      this.alarms.set(message.id, message);
      return;
    }
    const wheel = this.wheel(name);
    // What comes out of the history or a bus's memory is not what is heard now: only a status tells of a live monitor.
    if (parts[3] === "status") {
      wheel.status = message;
      wheel.heard = entry.received_wall_ns / 1e6;
    } else if (parts[3] === "diagnosis") this.addDiagnosis(wheel, message);
    else if (parts[3] === "changepoints") wheel.jumps.push(...message.changepoints);
    else if (parts[3] === "samples") this.addSamples(wheel, message);
  }

  addDiagnosis(wheel, message) {
    const known = wheel.diagnoses;
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
      const friction = message.friction_torque_Nm;
      wheel.friction.push(friction ? friction[i] : null);
    });
    const over = wheel.t.length - MAX_POINTS;
    if (over > 0) for (const list of [wheel.t, wheel.speed, wheel.friction]) list.splice(0, over);
  }

  /** Whether the wheel's monitor is heard; what is known of a silent one is its last state, not its present. */
  silent(wheel) {
    return this.live && (wheel.heard === null || this.now - wheel.heard > SILENT_MS);
  }

  openAlarms() {
    return [...this.alarms.values()].filter((alarm) => alarm.closed_ns === null);
  }
}

export const last = (wheel) => wheel.diagnoses[wheel.diagnoses.length - 1] ?? null;
