/**
 * Open MCT: the wheels of an rwa-monitor dashboard, with verdicts, friction, limits and alarms.
 *
 *     openmct.install(rwaMonitor({ server: "http://127.0.0.1:8750" }));
 *
 * History comes from the dashboard's REST interface, what is new from its feed, one WebSocket. It only reads: alarms are
 * acknowledged on the dashboard's own page. Times are the ends of windows on the wheel's clock, shown as UTC.
 */

const NAMESPACE = "rwa";
const FLEET = "fleet";
const VERDICT = "verdict";
const VERDICTS = ["nominal", "inconclusive", "anomalous"];
const MOST_WINDOWS = 1000; // that the dashboard gives at once
const DAY_MS = 86_400_000;
const RETRY_MS = 1000;
const NS_PER_MS = 1e6;

// Limits as Open MCT colours them. Of friction: outside the nominal range; and red where it is called anomalous.
const OUTSIDE = { high: "is-limit--upr is-limit--yellow", low: "is-limit--lwr is-limit--yellow" };
const ANOMALOUS = { cssClass: "is-limit--upr is-limit--red", name: "Anomalous" };
const INCONCLUSIVE = { cssClass: "is-limit--yellow", name: "Inconclusive" };
// Open MCT has three severities; an alarm that returned to normal waits to be acknowledged, and is a watch here.
const SEVERITY = { normal: "WATCH", watch: "WATCH", warning: "WARNING", distress: "CRITICAL", critical: "CRITICAL" };

/** Ask the dashboard; throws where it does not answer. */
async function ask(server, path) {
  const answer = await fetch(`${server}/api/${path}`);
  if (!answer.ok) throw new Error(`${path}: ${answer.status} ${await answer.text()}`);
  return answer.json();
}

/** The time that shows the latest windows of all wheels: their clocks need not be of today. */
export async function bounds(server, days = 30) {
  const entries = await ask(server, "fleet").catch(() => []);
  const ends = entries.filter(({ key }) => key.endsWith("/diagnosis")).map(({ message }) => message.window_end_ns / NS_PER_MS);
  const end = (ends.length ? Math.max(...ends) : Date.now()) + DAY_MS;
  return { start: end - days * DAY_MS, end };
}

/** What has come from the dashboard: the latest diagnosis of each wheel, and who wants to get the next ones. */
class Fleet {
  constructor(server) {
    this.server = server;
    this.latest = new Map(); // "spacecraft/wheel" → diagnosis
    this.diagnosed = new Set(); // called with the wheel's name, its diagnosis, and whether the wheel is new
    this.alarmed = new Set(); // called when an alarm changes
    this.ready = ask(server, "fleet").then((entries) => this.take(entries));
    this.connect();
  }

  connect() {
    const socket = new WebSocket(`${this.server.replace(/^http/, "ws")}/api/feed`);
    socket.onmessage = ({ data }) => this.take(JSON.parse(data));
    socket.onclose = () => setTimeout(() => this.connect(), RETRY_MS);
  }

  take(entries) {
    for (const { key, message } of entries) {
      const [, spacecraft, wheel, kind] = key.split("/");
      if (kind === "diagnosis") {
        const name = `${spacecraft}/${wheel}`;
        const known = this.latest.get(name);
        if (known && known.window_end_ns >= message.window_end_ns) continue; // a feed begins with what is known
        this.latest.set(name, message);
        for (const call of [...this.diagnosed]) call(name, message, !known);
      } else if (kind === "alarm") {
        for (const call of [...this.alarmed]) call(message);
      }
    }
  }
}

// ---- objects: fleet → wheel → verdict, and the friction of each part ------------------------------------------------

const TIME = { key: "utc", source: "utc", name: "End of window", format: "utc", hints: { domain: 1 } };
const VALUES = {
  [VERDICT]: [
    { key: "value", name: "Verdict", format: "enum", enumerations: VERDICTS.map((string, value) => ({ string, value })), hints: { range: 1 } },
    { key: "reason", name: "Reason", format: "string" },
  ],
  part: [
    { key: "value", name: "Friction", format: "number", hints: { range: 1 } },
    { key: "low", name: "Nominal from", format: "number" },
    { key: "high", name: "Nominal to", format: "number" },
    { key: "probability", name: "Probability of an anomaly", format: "number" },
    { key: "severity", name: "Severity", format: "number" },
  ],
};

// A key of an object: names of spacecraft and wheel hold no comma, and a comma may stand in an address.
const keyOf = (...parts) => ({ namespace: NAMESPACE, key: parts.join(",") });
const nameOf = ({ key }) => key.split(",").slice(0, 2).join("/");
const partOf = ({ key }) => key.split(",")[2];

function objectOf(fleet, identifier) {
  if (identifier.key === FLEET) return { identifier, name: "Reaction wheels", type: "rwa.fleet", location: "ROOT" };
  const [spacecraft, wheel, part] = identifier.key.split(",");
  if (part === undefined) return { identifier, name: `${spacecraft}/${wheel}`, type: "rwa.wheel", location: `${NAMESPACE}:${FLEET}` };
  const unit = fleet.latest.get(nameOf(identifier))?.anomalies[part]?.unit;
  const values = part === VERDICT ? VALUES[VERDICT] : VALUES.part.map((one) => (["value", "low", "high"].includes(one.key) ? { ...one, unit } : one));
  return {
    identifier,
    name: part === VERDICT ? `Verdict on ${wheel}` : `Friction of ${wheel}: ${part}`,
    type: part === VERDICT ? "rwa.verdict" : "rwa.part",
    location: `${NAMESPACE}:${spacecraft},${wheel}`,
    telemetry: { values: [TIME, ...values] },
  };
}

function childrenOf(fleet, { identifier }) {
  if (identifier.key === FLEET) return [...fleet.latest.keys()].sort().map((name) => keyOf(...name.split("/")));
  const parts = Object.keys(fleet.latest.get(nameOf(identifier))?.anomalies ?? {});
  return [VERDICT, ...parts].map((part) => keyOf(identifier.key, part));
}

/** Composition of the fleet and of a wheel; a wheel that appears is added to the tree. */
function compositions(fleet) {
  const listening = new Map();
  return {
    appliesTo: ({ type }) => type === "rwa.fleet" || type === "rwa.wheel",
    load: async (object) => {
      await fleet.ready;
      return childrenOf(fleet, object);
    },
    on(object, event, callback, context) {
      if (event !== "add" || object.identifier.key !== FLEET) return;
      const call = (name, _, isNew) => isNew && callback.call(context, keyOf(...name.split("/")));
      listening.set(callback, call);
      fleet.diagnosed.add(call);
    },
    off(_, event, callback) {
      fleet.diagnosed.delete(listening.get(callback));
      listening.delete(callback);
    },
  };
}

// ---- telemetry: windows, and their limits ---------------------------------------------------------------------------

/** A window as a datum of an object; null where it has nothing of it. */
function datumOf({ identifier }, diagnosis) {
  const utc = diagnosis.window_end_ns / NS_PER_MS;
  if (partOf(identifier) === VERDICT) return { utc, value: VERDICTS.indexOf(diagnosis.verdict), reason: diagnosis.reason };
  const part = diagnosis.anomalies[partOf(identifier)];
  if (!part || part.estimate === null) return null;
  const rounded = (number) => (number === null ? undefined : Number(number.toPrecision(5)));
  return {
    utc,
    value: rounded(part.estimate),
    low: rounded(part.nominal_low),
    high: rounded(part.nominal_high),
    probability: rounded(part.probability),
    severity: rounded(part.severity),
    active: part.active && diagnosis.verdict === "anomalous",
  };
}

function telemetry(fleet) {
  const mine = ({ type }) => type === "rwa.verdict" || type === "rwa.part";
  return {
    supportsRequest: mine,
    async request(object, { start, end, size, strategy } = {}) {
      const windows = await ask(fleet.server, `wheels/${nameOf(object.identifier)}/windows?limit=${MOST_WINDOWS}`);
      const data = windows.map((diagnosis) => datumOf(object, diagnosis)).filter((datum) => datum !== null);
      const within = data.filter(({ utc }) => utc >= (start ?? -Infinity) && utc <= (end ?? Infinity));
      return strategy === "latest" ? within.slice(-(size ?? 1)) : within;
    },
    supportsSubscribe: mine,
    subscribe(object, callback) {
      const call = (name, diagnosis) => {
        const datum = name === nameOf(object.identifier) ? datumOf(object, diagnosis) : null;
        if (datum) callback(datum);
      };
      fleet.diagnosed.add(call);
      return () => fleet.diagnosed.delete(call);
    },
    supportsLimits: mine,
    getLimitEvaluator: () => ({ evaluate: (datum, value) => (value && value.key !== "value" ? undefined : violation(datum)) }),
    getLimits: (object) => ({ limits: async () => limitsOf(fleet, object) }),
  };
}

/** The limit that a datum violates, undefined for none. */
function violation(datum) {
  if ("reason" in datum) return { anomalous: ANOMALOUS, inconclusive: INCONCLUSIVE }[VERDICTS[datum.value]];
  const { value, low = -Infinity, high = Infinity } = datum;
  if (datum.active) return { ...ANOMALOUS, low, high };
  if (value > high) return { cssClass: OUTSIDE.high, name: "Above nominal", low, high };
  if (value < low) return { cssClass: OUTSIDE.low, name: "Below nominal", low, high };
  return undefined;
}

/** The nominal range of a part, as lines in plots. */
function limitsOf(fleet, { identifier }) {
  const part = fleet.latest.get(nameOf(identifier))?.anomalies[partOf(identifier)];
  if (!part || part.nominal_low === null) return {};
  return { WATCH: { low: { color: "cyan", value: part.nominal_low }, high: { color: "cyan", value: part.nominal_high } } };
}

// ---- alarms as faults -----------------------------------------------------------------------------------------------

function faultOf(alarm) {
  const value = { value: alarm.level, rangeCondition: "", monitoringResult: SEVERITY[alarm.level] };
  return {
    type: "global-alarm-status",
    fault: {
      id: `${NAMESPACE}-${alarm.id}`,
      seqNum: alarm.id,
      name: `${alarm.name} of ${alarm.wheel}`,
      namespace: `/${alarm.spacecraft}/${alarm.wheel}`,
      severity: SEVERITY[alarm.level],
      acknowledged: alarm.phase === "acknowledged",
      shelved: alarm.shelved_until_wall_ns !== null,
      shortDescription: `${alarm.reason} ${alarm.advice}`,
      triggerTime: new Date(alarm.raised_ns / NS_PER_MS).toISOString(),
      triggerValueInfo: { ...value, value: alarm.peak },
      currentValueInfo: value,
    },
  };
}

function faults(fleet) {
  const mine = ({ type }) => type === "faultManagement";
  return {
    supportsRequest: mine,
    request: async () => (await ask(fleet.server, "alarms")).filter(({ closed_ns: closed }) => closed === null).map(faultOf),
    supportsSubscribe: mine,
    subscribe(_, callback) {
      const call = () => callback({ type: "global-alarm-status" });
      fleet.alarmed.add(call);
      call();
      return () => fleet.alarmed.delete(call);
    },
  };
}

// ---- the plugin -----------------------------------------------------------------------------------------------------

export default function rwaMonitor({ server = "http://127.0.0.1:8750" } = {}) {
  return function install(openmct) {
    const fleet = new Fleet(server.replace(/\/+$/, ""));
    const types = {
      "rwa.fleet": { name: "Reaction wheels", cssClass: "icon-folder" },
      "rwa.wheel": { name: "Reaction wheel", cssClass: "icon-object" },
      "rwa.verdict": { name: "Verdict", cssClass: "icon-telemetry" },
      "rwa.part": { name: "Friction of a part", cssClass: "icon-telemetry" },
    };
    for (const [key, type] of Object.entries(types)) openmct.types.addType(key, { ...type, creatable: false });
    openmct.objects.addRoot(keyOf(FLEET), openmct.priority.HIGH);
    openmct.objects.addProvider(NAMESPACE, {
      get: async (identifier) => {
        await fleet.ready;
        return objectOf(fleet, identifier);
      },
    });
    openmct.composition.addProvider(compositions(fleet));
    openmct.telemetry.addProvider(telemetry(fleet));
    openmct.install(openmct.plugins.FaultManagement());
    openmct.faults.addProvider(faults(fleet));
  };
}
