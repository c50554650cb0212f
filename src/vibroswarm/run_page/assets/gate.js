// When robots may decide at the earliest: at the first sample with more than O_c counted observations.

const GATE_COUNTS = { total: "observations, its own and received", received: "received bits", own: "own samples" };

// The time of a robot's first permitted decision, Infinity where it never has enough.
function gateTime(robot) {
  const { min_observations: least, gate, gate_counts_current: current } = run.rule, s = run.samples;
  for (let row = robot.first; row < robot.end; row++) {
    const own = row - robot.first + (current ? 1 : 0), heard = s.messages_received[row];
    if ((gate === "own" ? own : gate === "received" ? heard : own + heard) > least) return s.time_s[row];
  }
  return Infinity;
}

const gateTimes = robots.map(gateTime);
// A recording's robots may have decided by another rule than the one assumed: then no gate is shown.
const hasGate = run.rule.gated && run.rule.min_observations > 0
  && robots.every(({ final }, i) => final.decision < 0 || (final.decision_time_s ?? Infinity) >= gateTimes[i]);
const FIRST_PERMITTED_S = hasGate ? Math.min(...gateTimes) : 0;

// Until when it is too early: for the followed robot, or for all.
function tooEarlyUntil(followed) {
  return hasGate ? Math.min(followed ? gateTimes[followed.index] : FIRST_PERMITTED_S, END_S) : 0;
}

function gateSentence() {
  if (!hasGate) return "";
  const count = `more than ${run.rule.min_observations} ${GATE_COUNTS[run.rule.gate] ?? run.rule.gate}`;
  const until = FIRST_PERMITTED_S > END_S ? "no robot got that far (hatched)"
    : `before ${seconds(FIRST_PERMITTED_S)} it is too early for every robot (hatched)`;
  return ` It may decide only with ${count}: ${until}.`;
}

function drawTooEarly(context, box, followed) {
  const until = tooEarlyUntil(followed);
  if (until <= 0) return;
  const right = box.x(until), top = box.y(1), height = box.y(0) - top;
  context.save();
  context.beginPath();
  context.rect(box.left, top, right - box.left, height);
  context.clip();
  context.globalAlpha = 0.65;
  context.fillStyle = colours.paper;
  context.fillRect(box.left, top, right - box.left, height);
  context.globalAlpha = 1;
  context.strokeStyle = colours["line-strong"];
  context.lineWidth = 1;
  for (let x = box.left - height; x < right; x += 9) line(context, x, top + height, x + height, top);
  context.restore();
  context.strokeStyle = colours["ink-3"];
  line(context, crisp(right), top, crisp(right), top + height);
}
