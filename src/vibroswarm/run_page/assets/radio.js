// Who hears whom: a line for each message to each robot, and how many were lost; absent where all hear all.

const LOST = 1; // analysis/message_log.py has all states
const radio = run.radio;

// Times at which messages to each robot were sent that it never hears.
const lostTimes = radio && robots.map((robot) => {
  const times = [];
  for (let m = 0; m < radio.sender.length; m++) {
    if (radio.state[m * robots.length + robot.index] === LOST) times.push(radio.time_s[m]);
  }
  return Float64Array.from(times);
});

const lostBy = (robot, t) => lastAtMost(lostTimes[robot.index], t, 0, lostTimes[robot.index].length) + 1;

// Lines from the sender to each receiver, which fade; a lost message is dashed and ends half-way, at a cross.
function drawRadio(context, view, poses, t, followed, flashS) {
  if (!radio) return;
  for (let m = lastAtMost(radio.time_s, t, 0, radio.time_s.length); m >= 0 && radio.time_s[m] > t - flashS; m--) {
    const sender = radio.sender[m], from = poses[sender];
    if (!from) continue;
    context.globalAlpha = 1 - (t - radio.time_s[m]) / flashS;
    robots.forEach((receiver, i) => {
      const state = radio.state[m * robots.length + i];
      if (!poses[i] || state > LOST || (followed && followed.index !== sender && followed !== receiver)) return;
      drawLink(context, view.x(from.x), view.y(from.y), view.x(poses[i].x), view.y(poses[i].y), state === LOST);
    });
  }
  context.globalAlpha = 1;
}

function drawLink(context, x0, y0, x1, y1, lost) {
  context.strokeStyle = lost ? colours.alert : colours["ink-3"];
  context.lineWidth = lost ? 1.5 : 1;
  if (!lost) return line(context, x0, y0, x1, y1);
  const x = (x0 + x1) / 2, y = (y0 + y1) / 2;
  context.setLineDash([4, 3]);
  line(context, x0, y0, x, y);
  context.setLineDash([]);
  line(context, x - 3, y - 3, x + 3, y + 3);
  line(context, x - 3, y + 3, x + 3, y - 3);
}
