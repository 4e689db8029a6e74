// Elements of the page. Names are always text, never markup.

export const by = (id) => document.getElementById(id);

// An element with attributes, listeners (onclick and so on) and children, which are elements or text.
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "class") element.className = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return element;
}

export function fill(element, ...children) { element.replaceChildren(...children.flat().filter((child) => child !== null && child !== undefined)); }

export const link = (text, onclick, title) => make("button", { type: "button", class: "link", onclick, title }, text);

export function say(text) { by("live").textContent = text; }

export const percent = (share) => `${Math.round(share * 100)} %`;
// A probability, which is never rounded up to certainty.
export const sure = (share) => `${(Math.floor(share * 1000) / 10).toFixed(1)} %`;
export const thousands = (count) => count.toLocaleString("en");

// Entries of a legend: [name of a colour, what it stands for]; conflicts are crosses.
export function legend(rows) {
  return rows.map(([name, text]) => {
    const dot = make("i", { class: name === "conflict" ? "cross" : null });
    if (name !== "conflict") dot.style.background = `var(--${name})`;
    return make("li", {}, dot, text);
  });
}

// A bar for each share of 0 to 1: [name, share or null, shown, whether much of it is bad].
export function parts(rows) {
  return rows.filter((row) => row[1] !== null && row[1] !== undefined).flatMap(([name, share, shown, bad]) => {
    const bar = make("i", { class: bad ? "bad" : null });
    bar.style.width = `${Math.max(0, Math.min(1, share)) * 100}%`;
    return [make("span", {}, name), make("div", { class: "bar-of" }, bar), make("b", {}, shown)];
  });
}
