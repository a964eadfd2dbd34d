import { ask } from "./ask.js";
import { h } from "./dom.js";
import { signed, utc } from "./format.js";
import { signature } from "./signature.js";
import { last } from "./store.js";

const EVENTS = { retired: "retired", brought_back: "brought back", telemetry_arrived: "back, as telemetry arrived" };

const words = (line) => `${utc(line.wall_ns)}: ${EVENTS[line.event]}${signed(line)}`;

/** The retired wheels, below the fleet's list; closed until somebody looks. */
export function retiredList(store, base) {
  const title = h("summary", {});
  const list = h("ul", {});
  const element = h("details", {}, title, list);
  let drawn = "";

  function refresh(matches) {
    const wheels = [...store.wheels.values()].filter((wheel) => store.isRetired(wheel.name) && matches(wheel));
    wheels.sort((a, b) => (a.name < b.name ? -1 : 1));
    const now = JSON.stringify(wheels.map((wheel) => [wheel.name, last(wheel)?.verdict, store.retirements.get(wheel.name)]));
    if (now === drawn) return;
    drawn = now;
    element.hidden = !wheels.length;
    title.textContent = `Retired (${wheels.length})`;
    list.replaceChildren(...wheels.map((wheel) => h("li", {}, h("a", { href: `${base}/wheel/${wheel.name}` }, `${wheel.spacecraft} / ${wheel.wheel}`), `, last known state: ${last(wheel)?.verdict ?? "nothing"}. ${words(store.retirements.get(wheel.name))}`)));
  }

  return { element, refresh };
}

/** On the page of a wheel without telemetry: retire it, bring it back, and who has done so. */
export function retirementCard(store, wheel) {
  const head = h("h2", {}, "On the list");
  const text = h("p", {});
  const button = h("button", {});
  const who = signature();
  const form = h("form", { onsubmit: (event) => { event.preventDefault(); change(); } }, who.fields, button, who.problem);
  const trail = h("details", { hidden: true });
  const element = h("section", { class: "card no-paper", "aria-label": "On the list", hidden: true }, head, text, form, trail);
  let drawn = "";

  function change() {
    const retire = !store.isRetired(wheel.name);
    who.post([`/api/wheels/${wheel.name}/retirement`], { retire }, retire ? "retired" : "brought back", (line) => {
      store.retirements.set(wheel.name, line);
      refresh(store.state(wheel));
    });
  }

  function refresh(state) {
    const retired = store.isRetired(wheel.name);
    const known = wheel.diagnoses.length || wheel.reported !== null;
    element.hidden = !store.live || !known || (state === "live" && !retired);
    const now = JSON.stringify([element.hidden, store.retirements.get(wheel.name)]);
    if (element.hidden || now === drawn) return;
    drawn = now;
    text.textContent = retired ? "This wheel is retired. It reappears when telemetry arrives." : "A retired wheel leaves the fleet's list; nothing of it is removed, and it reappears when its telemetry arrives.";
    button.textContent = retired ? "Bring back" : "Retire";
    if (store.retirements.has(wheel.name)) showTrail();
  }

  async function showTrail() {
    const lines = await ask(`/api/wheels/${wheel.name}/retirement`).catch(() => [store.retirements.get(wheel.name)]); // what this page has
    trail.hidden = !lines.length;
    trail.replaceChildren(h("summary", {}, `Audit trail (${lines.length})`), h("ul", {}, lines.map((line) => h("li", {}, words(line)))));
  }

  return { element, refresh };
}
