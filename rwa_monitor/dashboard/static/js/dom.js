/** Make an element. Text is always text, never markup: names and reasons come from outside. */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== null && value !== false && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return element;
}

/** Facts, each with what it is of, as the content of a list of definitions. */
export const facts = (pairs) => pairs.flatMap(([what, value]) => [h("dt", { class: "soft" }, what), h("dd", {}, value)]);

/** A table of rows below the names of its columns. */
export const table = (columns, rows) => h("table", {}, h("thead", {}, h("tr", {}, columns.map((text) => h("th", { scope: "col" }, text)))), h("tbody", {}, rows));

/** An entry of a chart's key: a mark in its colour, and what it stands for. */
export function keyEntry(mark, colour, text) {
  const one = h("span", {}, mark);
  one.style.color = colour;
  return h("span", {}, one, ` ${text}`);
}
