import { ask } from "./ask.js";
import { h } from "./dom.js";
import { utc } from "./format.js";
import { signature } from "./signature.js";
import { last } from "./store.js";

const DEED = { put_aside: "put aside", brought_back: "brought back", spoke_again: "back, for it spoke again" };

const words = (line) => `${utc(line.wall_ns)}: ${DEED[line.event]}${line.person ? ` by ${line.person}` : ""}${line.note ? `: “${line.note}”` : ""}`;

/** The wheels that are put aside, below the fleet's list; closed until somebody looks. */
export function asideList(store, base) {
  const title = h("summary", {});
  const list = h("ul", {});
  const element = h("details", {}, title, list);
  let drawn = "";

  function refresh(matches) {
    const wheels = [...store.wheels.values()].filter((wheel) => store.isAside(wheel.name) && matches(wheel));
    wheels.sort((a, b) => (a.name < b.name ? -1 : 1));
    const now = JSON.stringify(wheels.map((wheel) => [wheel.name, last(wheel)?.verdict, store.deeds.get(wheel.name)]));
    if (now === drawn) return;
    drawn = now;
    element.hidden = !wheels.length;
    title.textContent = `Put aside (${wheels.length})`;
    list.replaceChildren(...wheels.map((wheel) => h("li", {}, h("a", { href: `${base}/wheel/${wheel.name}` }, `${wheel.spacecraft} / ${wheel.wheel}`), `, last known: ${last(wheel)?.verdict ?? "nothing"}. ${words(store.deeds.get(wheel.name))}`)));
  }

  return { element, refresh };
}

/** On the page of a wheel that is not heard: put it aside, bring it back, and who has done so. */
export function asideCard(store, wheel) {
  const head = h("h2", {}, "On the list");
  const text = h("p", {});
  const button = h("button", {});
  const who = signature();
  const form = h("form", { onsubmit: (event) => { event.preventDefault(); change(); } }, who.fields, button, who.problem);
  const trail = h("details", { hidden: true });
  const element = h("section", { class: "card", "aria-label": "On the list", hidden: true }, head, text, form, trail);
  let drawn = "";

  function change() {
    const aside = !store.isAside(wheel.name);
    who.post([`/api/wheels/${wheel.name}/aside`], { aside }, aside ? "put aside" : "brought back", (line) => {
      store.deeds.set(wheel.name, line);
      refresh(store.state(wheel));
    });
  }

  function refresh(state) {
    const aside = store.isAside(wheel.name);
    const known = wheel.diagnoses.length || wheel.heard !== null;
    element.hidden = !store.live || !known || (state === "live" && !aside);
    const now = JSON.stringify([element.hidden, store.deeds.get(wheel.name)]);
    if (element.hidden || now === drawn) return;
    drawn = now;
    text.textContent = aside ? "This wheel is put aside. It comes back by itself when it speaks again." : "If this wheel is retired, put it aside: it leaves the fleet's list, nothing of it is removed, and it comes back by itself when it speaks again.";
    button.textContent = aside ? "Bring back" : "Put aside";
    if (store.deeds.has(wheel.name)) showTrail();
  }

  async function showTrail() {
    const lines = await ask(`/api/wheels/${wheel.name}/aside`).catch(() => [store.deeds.get(wheel.name)]); // what this page knows
    trail.hidden = !lines.length;
    trail.replaceChildren(h("summary", {}, `Audit trail (${lines.length})`), h("ul", {}, lines.map((line) => h("li", {}, words(line)))));
  }

  return { element, refresh };
}
