// Tables that are sorted by their headings, a switch of light and dark, and all that is folded open in print.
"use strict";

const byText = new Intl.Collator("en", { numeric: true });

// Rows as they came are kept, so that a third press gives them back.
for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0];
  const rows = [...body.rows];
  const headings = [...table.tHead.rows[0].cells];

  function sortBy(column, order) {
    const sign = order === "descending" ? -1 : 1;
    const keyed = rows.map((row, place) => {
      const cell = row.cells[column];
      const value = cell.dataset.value;
      return { row, place, missing: "missing" in cell.dataset, value: value === undefined ? cell.textContent : Number(value) };
    });
    if (order !== "none") {
      keyed.sort((a, b) => {
        if (a.missing || b.missing) return a.missing - b.missing || a.place - b.place;
        const apart = typeof a.value === "number" ? a.value - b.value : byText.compare(a.value, b.value);
        return sign * apart || a.place - b.place;
      });
    }
    body.append(...keyed.map((entry) => entry.row));
    headings.forEach((heading, place) => heading.setAttribute("aria-sort", place === column ? order : "none"));
  }

  headings.forEach((heading, column) => {
    heading.firstElementChild.addEventListener("click", () => {
      const next = { none: "ascending", ascending: "descending", descending: "none" };
      sortBy(column, next[heading.getAttribute("aria-sort")]);
    });
  });
}

const root = document.documentElement;
const systemDark = matchMedia("(prefers-color-scheme: dark)");
const theme = document.getElementById("theme");

function isDark() {
  return (root.dataset.theme ?? (systemDark.matches ? "dark" : "light")) === "dark";
}

function nameTheme() {
  theme.textContent = isDark() ? "Light" : "Dark";
  theme.setAttribute("aria-label", `Switch to ${isDark() ? "light" : "dark"} colours`);
}

theme.hidden = false;
theme.addEventListener("click", () => {
  root.dataset.theme = isDark() ? "light" : "dark";
  nameTheme();
});
systemDark.addEventListener("change", nameTheme);
nameTheme();

// What a link of the contents leads to may be folded.
function unfold() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  const folded = target?.closest("details");
  if (!folded) return;
  folded.open = true;
  target.scrollIntoView();
}
addEventListener("hashchange", unfold);
unfold();

// The contents show where one reads, and scroll by themselves to keep that in sight.
const contents = document.querySelector(".contents");

function follow() {
  const links = [...contents.querySelectorAll("a")];
  const entries = links.map((link) => [link, document.getElementById(link.hash.slice(1))]);
  let marked = null;

  function mark() {
    const seen = entries.filter(([, heading]) => heading.getClientRects().length > 0);
    const top = ([, heading]) => heading.getBoundingClientRect().top;
    const passed = seen.filter((entry) => top(entry) < 0.2 * innerHeight);
    const atEnd = scrollY > 0 && scrollY + innerHeight >= root.scrollHeight - 2;
    const last = (atEnd ? seen.at(-1) : passed.at(-1)) ?? seen[0];
    const [link] = seen.find((entry) => Math.abs(top(entry) - top(last)) < 2); // of those side by side, the first
    if (link === marked) return;
    marked?.removeAttribute("aria-current");
    link.setAttribute("aria-current", "location");
    marked = link;
    for (const item of contents.querySelectorAll("li")) item.classList.toggle("here", item.contains(link));
    const frame = contents.getBoundingClientRect();
    const at = link.getBoundingClientRect();
    if (at.top < frame.top + 40) contents.scrollTop += at.top - frame.top - 40;
    if (at.bottom > frame.bottom - 40) contents.scrollTop += at.bottom - frame.bottom + 40;
  }

  let waiting = false;
  function soon() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      mark();
    });
  }
  contents.classList.add("follows");
  for (const moment of ["scroll", "resize", "load"]) addEventListener(moment, soon, { passive: true });
  document.addEventListener("toggle", soon, true);
  mark();
}
if (contents) follow();

const opened = [];
addEventListener("beforeprint", () => {
  for (const details of document.querySelectorAll("details:not([open])")) {
    details.open = true;
    opened.push(details);
  }
});
addEventListener("afterprint", () => {
  for (const details of opened.splice(0)) details.open = false;
});
