// Colours, as the style sheet has them for light and dark; canvases ask here, and draw anew when they change.

const NAMES = ["bg", "panel", "ink", "soft", "line", "wall", "wall-pale", "free", "floor", "place", "grid", "query", "hit",
  "shared", "conflict", "rival", "match", "ambiguous", "none", "accent", "find"];
const listeners = [];
export const colour = {};

function read() {
  const style = getComputedStyle(document.documentElement);
  for (const name of NAMES) colour[name] = style.getPropertyValue(`--${name}`).trim();
}

export function whenThemed(listener) { listeners.push(listener); }

export function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  read();
  listeners.forEach((listener) => listener());
}

function kept() { try { return localStorage.getItem("theme"); } catch { return null; } }

export function start(button) {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  setTheme(kept() || (dark.matches ? "dark" : "light"));
  dark.addEventListener("change", () => { if (!kept()) setTheme(dark.matches ? "dark" : "light"); });
  button.addEventListener("click", () => {
    const theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    try { localStorage.setItem("theme", theme); } catch { /* it is kept until the page is closed */ }
    setTheme(theme);
  });
}

// A colour #rrggbb as red, green, blue.
export const parts = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));

// What a pixel of ImageData is, as one number, between two colours.
export function pixel(from, to, share) {
  const [a, b] = [parts(from), parts(to)];
  const [r, g, blue] = a.map((one, k) => Math.round(one + (b[k] - one) * share));
  return (255 << 24 | blue << 16 | g << 8 | r) >>> 0;
}
