for (const head of document.querySelectorAll("table.sortable th[scope=col]")) {
  head.tabIndex = 0;
  head.addEventListener("keydown", event => event.key === "Enter" && head.click());
  head.addEventListener("click", () => {
    const body = head.closest("table").tBodies[0], place = head.cellIndex;
    const up = head.getAttribute("aria-sort") !== "ascending";
    const key = row => row.cells[place].dataset.value;
    const order = (a, b) => (isNaN(key(a)) || isNaN(key(b)) ? key(a).localeCompare(key(b)) : key(a) - key(b));
    const empty = row => key(row) === "";
    for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    body.append(...[...body.rows].sort((a, b) => empty(a) - empty(b) || (up ? order(a, b) : order(b, a))));
  });
}
