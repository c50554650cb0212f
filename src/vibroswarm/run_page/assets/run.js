// Questions to the run: where is a robot at a time, what was its latest sample, who has decided.

const run = readRun();
const END_S = run.time.end_s;
const STILL = 0, VIBRATING = 1;

// The last index in [from, to) whose value is at most x; from - 1 if there is none.
function lastAtMost(values, x, from, to) {
  let low = from, high = to;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] <= x) low = middle + 1; else high = middle;
  }
  return low - 1;
}

// Robots in the order of the table, each with its samples' range [first, end) and its track.
const robots = (() => {
  const rows = run.samples.robot;
  let at = 0;
  return run.robots.map((final, index) => {
    while (at < rows.length && rows[at] < final.robot) at++;
    const first = at;
    while (at < rows.length && rows[at] === final.robot) at++;
    return { index, id: final.robot, name: String(final.robot), final, first, end: at, track: run.tracks.get(final.robot) };
  });
})();

// Sample rows in the order in which they were taken.
const samplesByTime = Uint32Array.from(run.samples.time_s.keys()).sort(
  (a, b) => run.samples.time_s[a] - run.samples.time_s[b] || a - b);
const sampleTimes = Float64Array.from(samplesByTime, (row) => run.samples.time_s[row]);

// The row of a robot's latest own sample, or -1 before its first.
function latestSample(robot, t) {
  const row = lastAtMost(run.samples.time_s, t, robot.first, robot.end);
  return row < robot.first ? -1 : row;
}

// Whether robots count readings in a Beta posterior; those of some strategies keep something else.
const hasPosterior = run.samples.alpha.every((alpha) => !Number.isNaN(alpha));
// Whether robots report a belief.
const hasBelief = !run.samples.belief_below.length || run.samples.belief_below.some((belief) => !Number.isNaN(belief));

const PRIOR = {
  alpha: run.rule.prior_alpha, beta: run.rule.prior_beta, belief: hasBelief ? run.rule.prior_belief : NaN,
  decision: -1, samples: 0, received: 0,
};

// What a robot believed after its latest own sample.
function mindAt(robot, t) {
  const row = latestSample(robot, t);
  if (row < 0) return PRIOR;
  const s = run.samples;
  return {
    alpha: s.alpha[row], beta: s.beta[row], belief: s.belief_below[row], decision: s.decision[row],
    samples: row - robot.first + 1, received: s.messages_received[row],
  };
}

// The shorter way from one heading to another.
const turn = (from, to) => to - from - 2 * Math.PI * Math.round((to - from) / (2 * Math.PI));

// The pose between poses k and k + 1, on a straight line in time.
function poseBetween(track, k, t) {
  const next = Math.min(k + 1, track.time.length - 1), lasting = track.time[next] - track.time[k];
  const share = lasting > 0 ? Math.min(Math.max((t - track.time[k]) / lasting, 0), 1) : 0;
  return {
    x: track.x[k] + (track.x[next] - track.x[k]) * share,
    y: track.y[k] + (track.y[next] - track.y[k]) * share,
    heading: track.heading[k] + turn(track.heading[k], track.heading[next]) * share,
  };
}

// Where a robot is and what it does: its kind of movement, how far that is done (0 to 1), the way it turns.
function poseAt(robot, t) {
  const track = robot.track;
  if (!track) return null;
  const k = Math.max(lastAtMost(track.time, t, 0, track.time.length), 0);
  const pose = poseBetween(track, k, t);
  const next = Math.min(k + 1, track.time.length - 1);
  pose.kind = run.poses.kinds[track.kind[k]];
  pose.turning = Math.sign(turn(track.heading[k], track.heading[next]));
  return pose;
}

// Share of the stop that has passed, for a robot that samples.
function stopShare(robot, t) {
  const row = Math.max(latestSample(robot, t) + 1, robot.first);
  if (row >= robot.end) return 0;
  const begin = run.samples.stop_start_s[row], end = run.samples.time_s[row];
  return t < begin ? 0 : (t - begin) / (end - begin);
}

// Opinions may change: who exchanges them has decided from when on all agree.
function hasDecided(robot, t) {
  return run.rule.decides === "opinion" ? (robot.final.decision_time_s ?? Infinity) <= t : mindAt(robot, t).decision >= 0;
}

// Changes of each tile that changes, [time in s, kind] in the order of time.
const tileChanges = new Map();
for (const [time, tile, kind] of run.floor.changes) {
  if (!tileChanges.has(tile)) tileChanges.set(tile, []);
  tileChanges.get(tile).push([time, kind]);
}

function tileKind(tile, t) {
  const last = tileChanges.get(tile)?.findLast(([time]) => time <= t);
  return last ? last[1] : parseInt(run.floor.tiles[tile], 16);
}

const KIND_COUNT = run.kinds; // kinds of tile, and of readings
const KINDS = Array.from({ length: KIND_COUNT }, (_, kind) => kind);
const kindWord = (kind) => (KIND_COUNT > 2 ? `kind ${kind}` : kind === 1 ? "vibrating" : "still");

// Whether a place is on a patch of damage, which is not bound to tiles.
function isPatched(x, y) {
  return run.floor.patches.some(([px, py, width, height, disc]) => {
    const dx = Math.abs(x - px), dy = Math.abs(y - py);
    return disc ? Math.hypot(dx, dy) < width / 2 : dx < width / 2 && dy < height / 2;
  });
}

// How many changes there were by a time: the floor looks the same as long as their number is the same.
function changesBy(t) {
  return run.floor.changes.findLastIndex(([time]) => time <= t) + 1;
}

// A reading is wrong when it is not what the tile under the robot was then; without a tile, or on one with a value
// between still and vibrating, it is neither.
function isMisread(row) {
  const tile = run.samples.tile[row];
  if (tile < 0 || run.floor.has_values) return false;
  const patched = isPatched(run.samples.x_m[row], run.samples.y_m[row]);
  return run.samples.observation[row] !== (patched ? 1 : tileKind(tile, run.samples.time_s[row]));
}

// Index of the tile at a place, -1 where there is none.
function tileAt(x, y) {
  const f = run.floor;
  const column = Math.floor((x - f.left_m) / f.tile_width_m);
  const row = Math.floor((f.bottom_m + f.rows * f.tile_height_m - y) / f.tile_height_m);
  return column >= 0 && column < f.columns && row >= 0 && row < f.rows ? row * f.columns + column : -1;
}
