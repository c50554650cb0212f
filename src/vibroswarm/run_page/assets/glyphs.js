// The marks: a diamond says vibrating, a circle says still; filled or hollow as well, never colour alone. Further kinds
// are polygons: a square, a triangle, and from kind 4 on one corner more than their number.

function diamondPath(context, x, y, radius) {
  context.moveTo(x, y - radius);
  context.lineTo(x + radius, y);
  context.lineTo(x, y + radius);
  context.lineTo(x - radius, y);
  context.closePath();
}

const CORNERS = { 2: 4, 3: 3 };

function polygonPath(context, corners, x, y, radius) {
  const turn = corners === 4 ? Math.PI / 4 : -Math.PI / 2; // a square lies flat
  for (let i = 0; i < corners; i++) {
    const angle = turn + 2 * Math.PI * i / corners;
    context.lineTo(x + radius * Math.cos(angle), y + radius * Math.sin(angle));
  }
  context.closePath();
}

// Outline of what a bit or decision stands for.
function bitPath(context, bit, x, y, radius) {
  context.beginPath();
  if (bit === VIBRATING) diamondPath(context, x, y, radius * 1.22);
  else if (bit > VIBRATING) polygonPath(context, CORNERS[bit] ?? bit + 1, x, y, radius * 1.22);
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
