// The floor from above: three canvases on top of each other (floor, past samples, what moves).

const arena = { view: null, context: null, t: 0 };

// From metres to CSS pixels; y points up in the arena and down on the screen.
function arenaView(width) {
  const scale = width / run.arena.width_m, height = run.arena.height_m * scale;
  return {
    width, height, scale, x: (x) => x * scale, y: (y) => height - y * scale,
    toX: (x) => x / scale, toY: (y) => (height - y) / scale,
  };
}

const SMALLEST = 60; // width, CSS pixels

// The largest width that fits its column and, on a wide screen, the height that is left.
function arenaWidth(legendHeight) {
  const wide = matchMedia("(min-width: 960px)").matches;
  if (!wide) return Math.max(byId("legend").parentElement.clientWidth - 2, SMALLEST); // a hidden frame has no width
  const around = document.querySelector(".masthead").offsetHeight + document.querySelector(".player").offsetHeight;
  const room = innerHeight - around - legendHeight - 32;
  return Math.floor(Math.max(Math.min(innerWidth * 0.54, room * run.arena.width_m / run.arena.height_m), 280));
}

function layOutArena() {
  const frame = byId("arena-frame"), legend = byId("legend"), controls = byId("controls");
  legend.parentElement.style.minWidth = "";
  // How legend and controls break depends on the width, and the width on their height.
  let width = arenaWidth(66 + SCALE_STRIP);
  for (let again = 0; again < 3; again++) {
    legend.style.width = controls.style.width = `${width}px`;
    width = Math.min(width, arenaWidth(legend.offsetHeight + controls.offsetHeight + SCALE_STRIP));
  }
  legend.style.width = controls.style.width = `${width}px`;
  arena.view = arenaView(width);
  legend.parentElement.style.minWidth = `${width}px`;
  frame.style.width = `${arena.view.width}px`;
  frame.style.height = `${arena.view.height}px`;
  const fit = (id) => fitCanvas(byId(id), arena.view.width, arena.view.height);
  drawFloor(fit("floor"), arena.view);
  resetPast(fit("past"), arena.view);
  arena.context = fit("actors");
  drawScaleBar(arena.view);
}

function drawArena(t, followed, speed) {
  const { context, view } = arena, before = changesBy(arena.t);
  arena.t = t;
  if (changesBy(t) !== before) drawFloor(byId("floor").getContext("2d"), view);
  byId("past").style.visibility = layers.samples ? "" : "hidden";
  drawPast(t);
  context.clearRect(0, 0, view.width, view.height);
  const poses = robots.map((robot) => poseAt(robot, t));
  drawMap(context, view, t, followed);
  if (layers.paths) drawTrails(context, view, t, followed);
  if (layers.samples) drawFresh(context, view, t);
  if (layers.rays) drawRays(context, view, poses);
  drawPlaces(context, view, t, followed);
  robots.forEach((robot, i) => {
    if (poses[i] && !standsForGood(robot, poses[i], t)) drawDoing(context, view, robot, poses[i], t);
  });
  robots.forEach((robot, i) => {
    if (!poses[i]) return;
    const decision = mindAt(robot, t).decision;
    drawBody(context, view, poses[i], decision, robot === followed);
    if (faultsAt(robot, t).length) drawFault(context, view.x(poses[i].x), view.y(poses[i].y), bodyRadius(view));
    drawName(context, view, poses[i], decision, robot.name);
  });
  if (!layers.messages) return;
  robots.forEach((robot, i) => {
    if (poses[i]) drawMessage(context, view, robot, poses[i], t, flashTime(speed));
  });
}

// The legend, drawn with the same brushes as the floor.
const LEGEND = [
  ...(KIND_COUNT > 2 ? KINDS.flatMap((kind) => [
    [`kind ${kind}`, (c) => legendTile(c, kind)], [`read kind ${kind}`, (c) => drawSampleMark(c, 11, 9, 4, kind, false)],
  ]) : [
    ["vibrates", (c) => legendTile(c, VIBRATING)],
    ["still", (c) => legendTile(c, STILL)],
    ["read vibrating", (c) => drawSampleMark(c, 11, 9, 4, VIBRATING, false)],
    ["read still", (c) => drawSampleMark(c, 11, 9, 4, STILL, false)],
  ]),
  ...(run.floor.has_values ? [] : [["misread", (c) => drawSampleMark(c, 11, 9, 4, STILL, true)]]),
  ...(KIND_COUNT > 2 ? [] : [["bit sent", (c) => drawPip(c, 11, 9, 7.5, VIBRATING, "1")]]),
  ["too near", (c) => legendRay(c)],
  ...(run.places ? [["believes it is here", (c) => legendGhost(c)]] : []),
  ...(run.maps ? [["believed of a tile; larger: surer", (c) => drawMapMark(c, 11, 9, 6, 1)]] : []),
  ...(run.faults.length ? [["has a fault", (c) => drawFault(c, 11, 9, 5)]] : []),
];

function legendTile(context, kind) {
  fillTile(context, kind, [2, 1, 18, 16], kindPattern(context, kind, 4.5));
  context.strokeStyle = colours["line-strong"];
  context.lineWidth = 1;
  context.strokeRect(2.5, 1.5, 17, 15);
}

function legendGhost(context) {
  context.strokeStyle = colours["ink-2"];
  context.lineWidth = 1.5;
  context.setLineDash([3, 2.5]);
  context.beginPath();
  context.arc(11, 9, 6, 0, 2 * Math.PI);
  context.stroke();
  context.setLineDash([]);
}

function legendRay(context) {
  context.strokeStyle = context.fillStyle = colours.alert;
  context.lineWidth = 2;
  line(context, 2, 9, 17, 9);
  context.beginPath();
  context.arc(17, 9, 3, 0, 2 * Math.PI);
  context.fill();
}

function drawLegend() {
  const items = LEGEND.map(([text, draw]) => {
    const canvas = make("canvas", "");
    canvas.setAttribute("aria-hidden", "true");
    draw(fitCanvas(canvas, 22, 18));
    return make("span", "legend-item", canvas, text);
  });
  byId("legend").replaceChildren(...items);
}
