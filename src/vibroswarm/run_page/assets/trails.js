// The recent path of each robot, fading with age.

const TRAIL_S = 25, FOLLOWED_TRAIL_S = 120, TRAIL_BANDS = 5;

// Adds the path from time a to time b, through the poses between them.
function tracePath(context, view, track, a, b) {
  let k = Math.max(lastAtMost(track.time, a, 0, track.time.length), 0);
  const start = poseBetween(track, k, a);
  context.moveTo(view.x(start.x), view.y(start.y));
  for (k++; k < track.time.length && track.time[k] < b; k++) context.lineTo(view.x(track.x[k]), view.y(track.y[k]));
  const end = poseBetween(track, k - 1, b);
  context.lineTo(view.x(end.x), view.y(end.y));
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
