// Robots to scale: body, nose, number; what they do, see, have decided and say.

function drawRays(context, view, poses) {
  poses.forEach((pose, index) => {
    if (!pose || (pose.kind !== "drive" && pose.kind !== "avoid")) return;
    for (const ray of raysOf(index, poses)) {
      const x0 = view.x(ray.x), y0 = view.y(ray.y);
      const x1 = view.x(ray.x + ray.dx * ray.length), y1 = view.y(ray.y + ray.dy * ray.length);
      context.strokeStyle = ray.near ? colours.alert : colours["ink-3"];
      context.lineWidth = ray.near ? 2 : 1;
      context.setLineDash(ray.near ? [] : [3, 3]);
      line(context, x0, y0, x1, y1);
      context.fillStyle = context.strokeStyle;
      context.beginPath();
      context.arc(x1, y1, ray.near ? 3 : 1.8, 0, 2 * Math.PI);
      context.fill();
    }
  });
  context.setLineDash([]);
}

const bodyRadius = (view) => run.body.radius_m * view.scale;

function drawBody(context, view, pose, decision, followed) {
  const x = view.x(pose.x), y = view.y(pose.y), r = bodyRadius(view);
  if (followed) {
    context.beginPath();
    context.arc(x, y, r * 2.5, 0, 2 * Math.PI);
    context.strokeStyle = colours.ink;
    context.lineWidth = 1.5;
    context.setLineDash([2, 4]);
    context.stroke();
    context.setLineDash([]);
  }
  const colour = decision < 0 ? colours.ink : colours.of[decision];
  drawNose(context, x, y, r, pose.heading, colour, decision < 0 ? 1.75 : 2.05);
  context.beginPath();
  context.arc(x, y, r, 0, 2 * Math.PI);
  context.fillStyle = decision < 0 ? colours.panel : colour;
  context.fill();
  context.strokeStyle = decision < 0 ? colour : colours.panel;
  context.lineWidth = decision < 0 ? 1.75 : 1;
  context.stroke();
  if (decision < 0) return;
  bitPath(context, decision, x, y, decision === VIBRATING ? r * 1.42 : r * 1.28);
  context.strokeStyle = colour;
  context.lineWidth = 1.75;
  context.stroke();
}

// A wedge on the rim that points where the robot would drive.
function drawNose(context, x, y, r, heading, colour, tip) {
  context.beginPath();
  for (const [reach, aside] of [[tip, 0], [0.9, 0.55], [0.9, -0.55]]) {
    context.lineTo(x + r * reach * Math.cos(heading + aside), y - r * reach * Math.sin(heading + aside));
  }
  context.closePath();
  context.fillStyle = colour;
  context.fill();
}

function drawName(context, view, pose, decision, name) {
  const x = view.x(pose.x), y = view.y(pose.y), r = bodyRadius(view);
  if (r >= 7.5) {
    const size = Math.round(Math.min(r * (name.length > 1 ? 1 : 1.25), 17));
    return stampWords(context, name, x, y + 0.75, size, decision < 0 ? colours.ink : colours.panel);
  }
  const up = y < 26 ? 1 : -1;
  stampWords(context, name, x, y + up * (r + 9), 11, colours.ink, colours.panel);
}

// Sampling: a ring that fills. Turning: an arrow round the body; avoiding: the same in the warning colour.
function drawDoing(context, view, robot, pose, t) {
  const x = view.x(pose.x), y = view.y(pose.y), r = bodyRadius(view) * 1.62 + 1.5;
  if (pose.kind === "stop") {
    context.lineWidth = 3;
    context.strokeStyle = colours.panel;
    context.beginPath();
    context.arc(x, y, r, 0, 2 * Math.PI);
    context.stroke();
    context.strokeStyle = colours.ink;
    context.beginPath();
    context.arc(x, y, r, -Math.PI / 2, -Math.PI / 2 + 2 * Math.PI * stopShare(robot, t));
    context.stroke();
  } else if (pose.kind === "turn" || pose.kind === "avoid") {
    drawTurnArrow(context, x, y, r, pose, pose.kind === "avoid" ? colours.alert : colours["ink-2"]);
  }
}

function drawTurnArrow(context, x, y, r, pose, colour) {
  const way = pose.turning || 1;
  const from = -pose.heading - way * 0.6, to = from - way * 1.7;
  context.strokeStyle = context.fillStyle = colour;
  context.lineWidth = 1.75;
  context.beginPath();
  context.arc(x, y, r, from, to, way > 0);
  context.stroke();
  const head = 2.5 + r * 0.18;
  context.beginPath();
  for (const [bend, out] of [[-way * head * 1.7 / r, 0], [0, head], [0, -head]]) {
    context.lineTo(x + (r + out) * Math.cos(to + bend), y + (r + out) * Math.sin(to + bend));
  }
  context.closePath();
  context.fill();
}

// A bit sent: a ring that widens, with the bit beside the robot.
function drawMessage(context, view, robot, pose, t, flashS) {
  const row = latestSample(robot, t);
  if (row < 0) return;
  const age = (t - run.samples.time_s[row]) / flashS;
  if (age >= 1) return;
  const bit = run.samples.message[row];
  if (bit > 1) return;  // a recording may not tell it
  const x = view.x(run.samples.x_m[row]), y = view.y(run.samples.y_m[row]), r = bodyRadius(view);
  context.strokeStyle = colours.of[bit];
  context.globalAlpha = 1 - age;
  context.lineWidth = 2.25;
  bitPath(context, bit, x, y, calm.matches ? r * 2.2 : r * (1.5 + 1.6 * Math.sqrt(age)));
  context.stroke();
  context.globalAlpha = Math.min(2 - 2 * age, 1);
  const px = Math.min(view.x(pose.x) + r * 1.5 + 8, view.width - 9), py = Math.max(view.y(pose.y) - r * 1.5 - 6, 10);
  drawPip(context, px, py, 8, bit, String(bit));
  context.globalAlpha = 1;
}

// How long a message is seen, s of the run: longer when the run goes by fast, within reason.
const flashTime = (speed) => Math.min(Math.max(0.3 * speed, 1.2), 2.4);
