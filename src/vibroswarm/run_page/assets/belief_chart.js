// Beliefs of all robots over time. The curves are drawn once, faint and strong; each frame shows the strong
// ones up to the cursor.

const beliefChart = { context: null, box: null, faint: null, strong: null, followed: null, hovered: null, band: null };

function layOutBelief() {
  const width = Math.max(byId("belief-frame").clientWidth, 80);
  const plot = innerWidth < 640 ? 170 : Math.min(Math.max(innerHeight * 0.22, 150), 280);
  const box = beliefBox(width, plot);
  const context = fitCanvas(byId("belief"), width, box.total);
  Object.assign(beliefChart, { box, width, context, words: beliefWords(context, box), band: isCrowd && beliefBand(box) });
  drawBeliefLayers(beliefChart.followed);
}

function drawBeliefLayers(followed) {
  const { box, width } = beliefChart;
  beliefChart.followed = followed;
  const layer = () => hiddenCanvas(width, box.total);
  const faint = layer(), strong = layer();
  drawBeliefFrame(faint.context, box, followed);
  if (isCrowd) for (const [layer, strength] of [[faint, 0.3], [strong, 1]]) drawBand(layer.context, box, beliefChart.band, strength);
  const lines = isCrowd && !layers.lines ? [] : robots;
  faint.context.globalAlpha = 0.22;
  for (const robot of lines) strokeBelief(faint.context, robot, box, 1, false);
  faint.context.globalAlpha = 1;
  for (const robot of lines) {
    strong.context.globalAlpha = isCrowd || (followed && robot !== followed) ? 0.3 : 0.75;
    if (robot !== followed) strokeBelief(strong.context, robot, box, 1.3, true);
  }
  strong.context.globalAlpha = 1;
  if (followed) strokeBelief(strong.context, followed, box, 2.6, true);
  const written = layer();
  drawBeliefWords(written.context, beliefChart.words);
  Object.assign(beliefChart, { faint: faint.canvas, strong: strong.canvas, written: written.canvas });
}

// A robot's belief as steps; in the colour of its decision from then on.
function strokeBelief(context, robot, box, weight, coloured) {
  const s = run.samples, decided = robot.final.decision_time_s ?? Infinity;
  context.lineWidth = weight;
  context.lineJoin = "round";
  context.strokeStyle = colours.ink;
  context.beginPath();
  let y = box.y(PRIOR.belief);
  context.moveTo(box.left, y);
  for (let row = robot.first; row < robot.end; row++) {
    const x = box.x(s.time_s[row]);
    context.lineTo(x, y);
    y = box.y(s.belief_below[row]);
    context.lineTo(x, y);
    if (!coloured || s.time_s[row] !== decided) continue;
    context.stroke();
    context.strokeStyle = colours.of[robot.final.decision];
    context.beginPath();
    context.moveTo(x, y);
  }
  context.lineTo(box.left + box.width, y);
  context.stroke();
}

function drawBelief(t, followed) {
  if (followed !== beliefChart.followed) drawBeliefLayers(followed);
  const { context, box, faint, strong, width, written } = beliefChart;
  const ratio = faint.width / width, now = box.x(t);
  context.clearRect(0, 0, width, box.total);
  context.drawImage(faint, 0, 0, width, box.total);
  const seen = Math.max(Math.round(now * ratio), 1);
  context.drawImage(strong, 0, 0, seen, strong.height, 0, 0, seen / ratio, box.total);
  if (beliefChart.hovered) strokeBelief(context, beliefChart.hovered, box, 2, true);
  context.drawImage(written, 0, 0, width, box.total);
  for (const flag of box.flags) drawFlag(context, box, flag, flag.time <= t);
  drawCursor(context, box, now, t, followed);
}

function drawFlag(context, box, flag, past) {
  context.globalAlpha = past ? 1 : 0.4;
  context.strokeStyle = colours.of[flag.robot.final.decision];
  context.lineWidth = 1;
  context.beginPath();
  context.moveTo(flag.place, flag.radius * 2);
  context.lineTo(flag.x, box.top - 5);
  context.lineTo(flag.x, box.y(hasBelief ? flag.belief ?? 0.5 : 0));
  context.stroke();
  drawPip(context, flag.place, flag.radius, flag.radius, flag.robot.final.decision, flag.name,
    flag.robots.length > 1 ? 9 : undefined);
  context.globalAlpha = 1;
}

function drawCursor(context, box, x, t, followed) {
  context.strokeStyle = colours.ink;
  context.lineWidth = 1.5;
  line(context, x, box.y(1) - 4, x, box.y(0) + 4);
  context.fillStyle = colours.ink;
  context.beginPath();
  for (const [dx, dy] of [[0, 2], [6, 10], [-6, 10]]) context.lineTo(x + dx, box.y(0) + dy);
  context.fill();
  for (const robot of isCrowd ? [followed, beliefChart.hovered].filter(Boolean) : robots) {
    const mind = mindAt(robot, t);
    bitPath(context, Math.max(mind.decision, 0), x, box.y(mind.belief), robot === followed ? 4.5 : 3);
    context.fillStyle = mind.decision < 0 ? colours.panel : colours.of[mind.decision];
    context.fill();
    context.strokeStyle = colours.ink;
    context.lineWidth = 1.25;
    context.stroke();
  }
}

// The robot whose belief is nearest to a place in the chart, and what it is there.
function beliefNear(x, y) {
  const { box } = beliefChart;
  if (x < box.left || x > box.left + box.width || y < box.top - 4 || y > box.y(0) + 4) return null;
  const time = box.time(x);
  let best = null;
  for (const robot of robots) {
    const belief = mindAt(robot, time).belief;
    const far = Math.abs(box.y(belief) - y) - (robot === beliefChart.followed ? 6 : 0);
    if (!best || far < best.far) best = { robot, time, belief, far };
  }
  return best;
}
