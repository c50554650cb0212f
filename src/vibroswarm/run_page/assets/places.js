// Where robots believe they sampled: a dashed ghost, a disc of two standard deviations, and a line to the true place.

const SPREADS = 2;

// A robot's estimate at its latest sample, null before the first and where robots do not estimate places.
function placeAt(robot, t) {
  const row = run.places ? latestSample(robot, t) : -1;
  if (row < 0 || Number.isNaN(run.places.x_m[row])) return null;
  const { x_m: x, y_m: y, heading_rad: heading, spread_m: spread } = run.places;
  return {
    x: x[row], y: y[row], heading: heading[row], spread: spread[row],
    trueX: run.samples.x_m[row], trueY: run.samples.y_m[row],
  };
}

function drawPlaces(context, view, t, followed) {
  if (!run.places || !layers.places) return;
  for (const robot of robots) {
    const place = placeAt(robot, t);
    if (!place) continue;
    context.globalAlpha = followed && robot !== followed ? 0.35 : 1;
    drawGhost(context, view, place);
  }
  context.globalAlpha = 1;
}

function drawGhost(context, view, place) {
  const x = view.x(place.x), y = view.y(place.y), r = bodyRadius(view);
  context.save();
  context.globalAlpha *= 0.14;
  context.fillStyle = colours.ink;
  context.beginPath();
  context.arc(x, y, SPREADS * place.spread * view.scale, 0, 2 * Math.PI);
  context.fill();
  context.restore();
  context.strokeStyle = colours["ink-2"];
  context.lineWidth = 1;
  line(context, x, y, view.x(place.trueX), view.y(place.trueY));
  context.lineWidth = 1.5;
  context.setLineDash([3, 2.5]);
  context.beginPath();
  context.arc(x, y, r, 0, 2 * Math.PI);
  context.stroke();
  context.setLineDash([]);
  line(context, x, y, x + r * Math.cos(place.heading), y - r * Math.sin(place.heading));
}

// For the note of a robot: how far its estimate is off, and how far it says it may be.
function placeNote(robot, t) {
  const place = placeAt(robot, t);
  if (!place) return [];
  const off = Math.hypot(place.x - place.trueX, place.y - place.trueY);
  return [["believed place off by", exactCm(off)], ["standard deviation it states", exactCm(place.spread)]];
}
