// Light and dark: follows the system until the button is used. Canvases read their colours here.

const COLOUR_NAMES = [
  "paper", "panel", "ink", "ink-2", "ink-3", "line", "line-strong", "still", "vibrating", "still-soft",
  "vibrating-soft", "tile-still", "tile-vibrating", "ripple", "alert", "bare",
];
const colours = {};
const themeListeners = [];
const systemDark = matchMedia("(prefers-color-scheme: dark)");
const calm = matchMedia("(prefers-reduced-motion: reduce)");

function themeName() {
  return document.documentElement.dataset.theme ?? (systemDark.matches ? "dark" : "light");
}

function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of COLOUR_NAMES) colours[name] = style.getPropertyValue(`--${name}`).trim();
  colours.of = KINDS.map((kind) => [colours.still, colours.vibrating][kind]
    ?? style.getPropertyValue(`--kind-${2 + (kind - 2) % 6}`).trim()); // six colours for all further kinds
  colours.soft = [colours["still-soft"], colours["vibrating-soft"]];
}

function applyTheme() {
  readColours();
  const other = themeName() === "dark" ? "light" : "dark";
  byId("theme").textContent = other === "dark" ? "Dark" : "Light";
  byId("theme").setAttribute("aria-label", `Switch to ${other} colours`);
  for (const listener of themeListeners) listener();
}

function toggleTheme() {
  document.documentElement.dataset.theme = themeName() === "dark" ? "light" : "dark";
  applyTheme();
}

// On paper it is always light.
function printLight() {
  const { dataset } = document.documentElement;
  const onScreen = dataset.theme;
  dataset.theme = "light";
  applyTheme();
  addEventListener("afterprint", () => {
    if (onScreen) dataset.theme = onScreen;
    else delete dataset.theme;
    applyTheme();
  }, { once: true });
}

byId("theme").addEventListener("click", toggleTheme);
addEventListener("beforeprint", printLight);
systemDark.addEventListener("change", applyTheme);
readColours();
