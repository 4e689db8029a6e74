// What is shown, as it stands after the # of the page's address, so that every view can be linked to.

const listeners = [];

export function shown() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

// Changes some of what is shown; null leaves one out. With `quietly` no step back is added to the history.
export function show(changes, quietly = false) {
  const before = shown(), after = { ...before, ...changes };
  const parameters = new URLSearchParams();
  for (const [name, value] of Object.entries(after)) {
    if (value !== null && value !== undefined && value !== "") parameters.set(name, value);
  }
  const hash = parameters.size ? `#${parameters}` : "#";
  if (hash === (location.hash || "#")) return;
  history[quietly ? "replaceState" : "pushState"](null, "", hash);
  tell(before);
}

export function whenShown(listener) {
  listeners.push(listener);
}

let last = shown();
function tell(before) {
  last = shown();
  for (const listener of listeners) listener(last, before);
}

addEventListener("popstate", () => tell(last));
addEventListener("hashchange", () => { if (JSON.stringify(shown()) !== JSON.stringify(last)) tell(last); });
