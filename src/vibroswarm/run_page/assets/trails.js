// The recent path of each robot, fading with age.

const TRAIL_S = 25, FOLLOWED_TRAIL_S = 120, TRAIL_BANDS = 5;

// Adds the path from time a to time b, through the knots between them.
function tracePath(context, view, track, a, b) {
  let k = Math.max(lastAtMost(track.time, a, 0, track.time.length), 0);
  const start = poseBetween(track, k, a);
  context.moveTo(view.x(start.x), view.y(start.y));
  for (let from = a; from < b && k < track.time.length; k++) {
    const to = Math.min(track.time[k + 1] ?? b, b);
    const moved = track.x[k + 1] !== track.x[k] || track.y[k + 1] !== track.y[k];
    const steps = moved ? Math.ceil(Math.abs((track.heading[k + 1] ?? 0) - track.heading[k]) / 0.12) || 1 : 0;
    for (let i = 1; i <= steps; i++) {
      const pose = poseBetween(track, k, from + (to - from) * i / steps);
      context.lineTo(view.x(pose.x), view.y(pose.y));
    }
    from = to;
  }
}

function drawTrails(context, view, t, followed) {
  context.lineJoin = "round";
  context.lineCap = "butt";
  context.strokeStyle = colours.ink;
  for (let band = 0; band < TRAIL_BANDS; band++) {
    context.globalAlpha = 0.1 + 0.5 * band / TRAIL_BANDS;
    for (const thick of [false, true]) {
      context.lineWidth = thick ? 2.6 : 1.3;
      context.beginPath();
      for (const robot of robots) {
        if (!robot.track || (robot === followed) !== thick) continue;
        const long = thick ? FOLLOWED_TRAIL_S : TRAIL_S;
        const a = t - long + long * band / TRAIL_BANDS;
        tracePath(context, view, robot.track, Math.max(a, 0), Math.max(a + long / TRAIL_BANDS, 0));
      }
      context.stroke();
    }
  }
  context.globalAlpha = 1;
}
