// A small note beside the pointer: a heading and lines of name and value.

const tooltip = byId("tooltip");

let tooltipNow = null; // how to write the note again when time goes on

// A note that is written again as time goes on under a pointer that rests.
function liveTooltip(event, note) {
  showTooltip(event, ...note());
  tooltipNow = { event, note };
}

function refreshTooltip() {
  if (!tooltip.hidden && tooltipNow) liveTooltip(tooltipNow.event, tooltipNow.note);
}

function showTooltip(event, heading, rows) {
  tooltipNow = null;
  const lines = rows.map(([name, value]) => make("div", "", make("span", "", name), make("b", "", value)));
  tooltip.replaceChildren(make("p", "", heading), ...lines);
  tooltip.hidden = false;
  const { width, height } = tooltip.getBoundingClientRect();
  const left = event.clientX + 16 + width > innerWidth - 8 ? event.clientX - 16 - width : event.clientX + 16;
  const top = event.clientY + 16 + height > innerHeight - 8 ? event.clientY - 12 - height : event.clientY + 16;
  tooltip.style.left = `${Math.min(Math.max(left, 8), Math.max(innerWidth - width - 8, 8))}px`;
  tooltip.style.top = `${Math.max(top, 8)}px`;
}

function hideTooltip() {
  tooltip.hidden = true;
}

// The pointer's place inside an element, CSS pixels.
function placeIn(element, event) {
  const box = element.getBoundingClientRect();
  return { x: event.clientX - box.left, y: event.clientY - box.top };
}
