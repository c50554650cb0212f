// The floor: drawn once, and again when its size, the colours or its tiles change.

function drawFloor(context, view) {
  context.clearRect(0, 0, view.width, view.height);
  context.fillStyle = colours.bare;
  context.fillRect(0, 0, view.width, view.height);
  context.fillStyle = dotPattern(context);
  context.fillRect(0, 0, view.width, view.height);
  drawTiles(context, view);
  drawRuler(context, view);
}

// Edges of tile columns and rows in whole pixels, so that no seams show.
function tileEdges(view) {
  const f = run.floor, ratio = pixelRatio();
  const snap = (value) => Math.round(value * ratio) / ratio;
  const top = f.bottom_m + f.rows * f.tile_height_m;
  return {
    x: Array.from({ length: f.columns + 1 }, (_, i) => snap(view.x(f.left_m + i * f.tile_width_m))),
    y: Array.from({ length: f.rows + 1 }, (_, i) => snap(view.y(top - i * f.tile_height_m))),
  };
}

function drawTiles(context, view) {
  const f = run.floor, edges = tileEdges(view);
  const gap = Math.min(Math.max(f.tile_height_m * view.scale / 12, 4), 11);
  const patterns = KINDS.map((kind) => kindPattern(context, kind, gap));
  for (let tile = 0; tile < f.rows * f.columns; tile++) {
    const column = tile % f.columns, row = (tile - column) / f.columns;
    const box = [edges.x[column], edges.y[row], edges.x[column + 1] - edges.x[column], edges.y[row + 1] - edges.y[row]];
    const kind = tileKind(tile, arena.t);
    fillTile(context, kind, box, patterns[kind]);
  }
  context.strokeStyle = colours.line;
  context.lineWidth = 1;
  for (const x of edges.x) line(context, crisp(x), edges.y[0], crisp(x), edges.y[f.rows]);
  for (const y of edges.y) line(context, edges.x[0], crisp(y), edges.x[f.columns], crisp(y));
  drawPatches(context, view, patterns[VIBRATING]);
}

// What tells a kind of tile without colour: nothing on still ones, waves on vibrating ones, straight lines on others, which
// are turned from kind to kind.
function kindPattern(context, kind, gap) {
  if (kind === STILL) return "transparent";
  if (kind === VIBRATING) return wavePattern(context, colours.ripple, gap * 2.4, gap, 1.15);
  const round = Math.floor((kind - 2) / 4);
  return linePattern(context, colours.of[kind], gap / (1 + round), [45, 135, 90, 0][(kind - 2) % 4]);
}

// A tile; kinds beside still and vibrating have a light shade of the colour of their readings.
function fillTile(context, kind, box, pattern) {
  context.fillStyle = kind === VIBRATING ? colours["tile-vibrating"] : colours["tile-still"];
  context.fillRect(...box);
  if (kind > VIBRATING) {
    context.globalAlpha = 0.25;
    context.fillStyle = colours.of[kind];
    context.fillRect(...box);
    context.globalAlpha = 1;
  }
  context.fillStyle = pattern;
  context.fillRect(...box);
}

// Patches of damage, which are not bound to tiles; the fainter, the lower their contrast.
function drawPatches(context, view, waves) {
  for (const [x, y, width, height, disc, contrast] of run.floor.patches) {
    const [w, h] = [width * view.scale, height * view.scale];
    context.beginPath();
    if (disc) context.arc(view.x(x), view.y(y), w / 2, 0, 2 * Math.PI);
    else context.rect(view.x(x) - w / 2, view.y(y) - h / 2, w, h);
    context.globalAlpha = 0.25 + 0.75 * contrast;
    for (const fill of [colours["tile-vibrating"], waves]) {
      context.fillStyle = fill;
      context.fill();
    }
    context.globalAlpha = 1;
    context.strokeStyle = colours.ripple;
    context.lineWidth = 1;
    context.stroke();
  }
}

function dotPattern(context) {
  const { canvas, context: brush } = hiddenCanvas(8, 8);
  brush.fillStyle = colours["line-strong"];
  brush.fillRect(3.5, 3.5, 1, 1);
  const pattern = context.createPattern(canvas, "repeat");
  pattern.setTransform(new DOMMatrix([8 / canvas.width, 0, 0, 8 / canvas.height, 0, 0]));
  return pattern;
}

const SCALE_LENGTHS_M = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50];

// Ticks along the walls, every 10 cm or, where these would touch, farther apart.
function drawRuler(context, view) {
  const step = SCALE_LENGTHS_M.find((length) => length >= 0.1 && length * view.scale >= 8) ?? SCALE_LENGTHS_M.at(-1);
  context.strokeStyle = colours["ink-3"];
  context.lineWidth = 1;
  for (let x = step; x < run.arena.width_m - 1e-6; x += step) {
    line(context, crisp(view.x(x)), view.height, crisp(view.x(x)), view.height - 5);
  }
  for (let y = step; y < run.arena.height_m - 1e-6; y += step) line(context, 0, crisp(view.y(y)), 5, crisp(view.y(y)));
}

// A bar of a round length, at most a quarter of the width that is seen.
function scaleBar(view) {
  const most = view.width / view.scale / 4;
  const metres = SCALE_LENGTHS_M.filter((length) => length <= most).pop() ?? SCALE_LENGTHS_M[0];
  return { metres, width: metres * view.scale, words: metres < 1 ? `${Math.round(100 * metres)} cm` : `${metres} m` };
}

const SCALE_STRIP = 20; // CSS pixels below the floor: the bar covers nothing

function drawScaleBar(view) {
  const context = fitCanvas(byId("scale"), view.width, SCALE_STRIP);
  const { width, words } = scaleBar(view), right = view.width - 2, y = SCALE_STRIP / 2;
  context.strokeStyle = context.fillStyle = colours.ink;
  context.lineWidth = 2;
  line(context, right - width, y, right, y);
  context.lineWidth = 1.5;
  for (const x of [right - width, right]) line(context, x, y - 4, x, y + 4);
  context.font = `600 11px ${FONT}`;
  context.textAlign = "right";
  context.textBaseline = "middle";
  context.fillText(words, right - width - 6, y + 0.5);
}
