// What robots believe of each tile: a mark in its corner, the larger the surer; of the followed robot, else of all samples.

// The belief that a tile vibrates, from samples up to t; null where robots keep no map.
function tileBelief(tile, t, followed) {
  const m = run.maps;
  if (!m) return null;
  const tiles = run.floor.rows * run.floor.columns, times = m.beliefs.length / (m.count * tiles);
  const k = Math.min(Math.max(Math.floor(t / m.step_s + 1e-6), 0), times - 1);
  const of = followed && m.count > 1 ? robots.indexOf(followed) : m.count - 1;
  return m.beliefs[(k * m.count + of) * tiles + tile] / 255;
}

function drawMapMark(context, x, y, most, belief) {
  const bit = belief > 0.5 ? VIBRATING : STILL, radius = most * Math.sqrt(Math.abs(2 * belief - 1));
  if (radius < 0.75) return;
  bitPath(context, bit, x, y, radius);
  context.fillStyle = colours.of[bit];
  context.fill();
  context.strokeStyle = colours.panel;
  context.lineWidth = 1;
  context.stroke();
}

function drawMap(context, view, t, followed) {
  if (!run.maps || !layers.map) return;
  const f = run.floor, width = f.tile_width_m * view.scale, height = f.tile_height_m * view.scale;
  const most = Math.min(0.11 * Math.min(width, height), 14), top = f.bottom_m + f.rows * f.tile_height_m;
  for (let tile = 0; tile < f.rows * f.columns; tile++) {
    const column = tile % f.columns, row = (tile - column) / f.columns;
    const x = view.x(f.left_m + column * f.tile_width_m) + 1.6 * most;
    const y = view.y(top - row * f.tile_height_m) + 1.6 * most;
    drawMapMark(context, x, y, most, tileBelief(tile, t, followed));
  }
}

// For the note of a tile.
function mapNote(tile, t, followed) {
  const belief = tileBelief(tile, t, followed);
  if (belief === null) return [];
  const whose = followed && run.maps.count > 1 ? `robot ${followed.name}` : "all samples together";
  return [[`believed to vibrate (${whose})`, `${Math.round(100 * belief)} %`]]; // packed in steps of 1/255
}
