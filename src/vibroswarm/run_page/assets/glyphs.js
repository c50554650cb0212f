// The marks: a diamond says vibrating, a circle says still; filled or hollow as well, never colour alone. Further kinds
// are a square, triangles that point up, down, left and right, and polygons from the pentagon on.

function diamondPath(context, x, y, radius) {
  context.moveTo(x, y - radius);
  context.lineTo(x + radius, y);
  context.lineTo(x, y + radius);
  context.lineTo(x - radius, y);
  context.closePath();
}

// The way that a corner of kinds 2 (a square) to 6 (triangles) points, in degrees clockwise from the right.
const CORNER_AT = { 2: 45, 3: -90, 4: 90, 5: 180, 6: 0 };

function polygonPath(context, kind, x, y, radius) {
  const corners = kind === 2 ? 4 : kind < 7 ? 3 : kind - 2, first = (CORNER_AT[kind] ?? -90) * Math.PI / 180;
  for (let i = 0; i < corners; i++) {
    const angle = first + 2 * Math.PI * i / corners;
    context.lineTo(x + radius * Math.cos(angle), y + radius * Math.sin(angle));
  }
  context.closePath();
}

// Outline of what a bit or decision stands for.
function bitPath(context, bit, x, y, radius) {
  context.beginPath();
  if (bit === VIBRATING) diamondPath(context, x, y, radius * 1.22);
  else if (bit > VIBRATING) polygonPath(context, bit, x, y, radius * 1.22);
  else context.arc(x, y, radius, 0, 2 * Math.PI);
}

// A sample: filled diamond (read as vibrating) or hollow circle (still); struck through where misread.
function drawSampleMark(context, x, y, size, bit, misread) {
  if (misread) {
    const reach = size * 1.7;
    context.strokeStyle = colours.ink;
    context.lineWidth = Math.max(size * 0.4, 1.1);
    line(context, x - reach, y + reach, x + reach, y - reach);
  }
  bitPath(context, bit, x, y, size);
  context.lineWidth = Math.max(size * 0.42, 1);
  context.strokeStyle = colours.of[bit];
  if (bit > STILL) {
    context.fillStyle = colours.of[bit];
    context.fill();
  } else {
    context.fillStyle = colours.panel;
    context.fill();
    context.stroke();
  }
}

// A robot's number in the shape of its decision; an empty ring while it has none.
function drawPip(context, x, y, radius, decision, name, size = Math.round(radius * 1.25)) {
  if (decision < 0) {
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fillStyle = colours.panel;
    context.fill();
    context.strokeStyle = colours["ink-3"];
    context.lineWidth = 1;
    context.stroke();
  } else {
    bitPath(context, decision, x, y, radius);
    context.fillStyle = colours.of[decision];
    context.fill();
  }
  stampWords(context, name, x, y + 0.5, size, decision < 0 ? colours["ink-2"] : colours.panel);
}
