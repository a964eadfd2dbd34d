import { ask } from "./ask.js";
import { h } from "./dom.js";
import { setToken, token } from "./token.js";

/** Who changes something, and why: the fields for it, and what posts the change or shows why it was refused. */
export function signature() {
  const name = h("input", { name: "name", placeholder: "your name", "aria-label": "Your name", required: true, maxlength: 100 });
  const note = h("input", { name: "note", placeholder: "note (optional)", "aria-label": "Note", maxlength: 2000 });
  const secret = h("input", { name: "token", type: "password", autocomplete: "off", placeholder: "token", "aria-label": "Token", hidden: true });
  const problem = h("span", { role: "alert", class: "anomalous" });

  /** Post a change to each of some paths, `done` in a word; gives `then` what the server answers. */
  async function post(paths, content, done, then) {
    if (!name.reportValidity()) return;
    try {
      if (!secret.hidden) setToken(secret.value);
      const body = JSON.stringify({ name: name.value, note: note.value, ...content });
      for (const path of paths) {
        const answer = await ask(path, { method: "POST", headers: { Authorization: `Bearer ${token()}`, "Content-Type": "application/json" }, body });
        problem.textContent = "";
        note.value = ""; // it was of this change
        name.blur();
        note.blur();
        then(answer);
      }
    } catch (error) {
      if (error.status === 401) secret.hidden = false; // whoever has it can write it here
      problem.textContent = `Not ${done}: ${error.message}`;
    }
  }

  return { fields: [name, note, secret], problem, post };
}
