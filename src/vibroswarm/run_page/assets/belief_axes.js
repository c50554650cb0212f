// The belief chart's frame: scales, bands beyond the thresholds, ticks, and flags where robots decided.

const FLAG_RADIUS = 8, FLAG_STEP = 19, FLAG_ROOM = 42;
const GROUP_STEP = 25; // flags with a number of robots are wider
const MOST_HIDDEN = 4;
const WORDS_FONT = `600 11.5px ${FONT}`;

// Even steps for an axis of time, at most `most` of them.
function timeSteps(end, most) {
  const step = [1, 2, 5, 10, 20, 30, 50, 100, 200, 300, 500, 1000].find((s) => end / s <= most)
    ?? 1000 * Math.ceil(end / 1000 / most);
  return Array.from({ length: Math.floor(end / step + 1e-9) + 1 }, (_, i) => i * step);
}

// Places as near as can be to those wanted (rising), at least a step apart, within low and high.
function spreadOut(wanted, step, low, high) {
  const gap = Math.min(step, (high - low) / Math.max(wanted.length - 1, 1));
  const groups = [];
  wanted.forEach((x, i) => {
    let group = { sum: x - i * gap, count: 1 };
    while (groups.length && groups[groups.length - 1].sum / groups[groups.length - 1].count > group.sum / group.count) {
      const before = groups.pop();
      group = { sum: before.sum + group.sum, count: before.count + group.count };
    }
    groups.push(group);
  });
  const most = high - gap * (wanted.length - 1);
  const places = groups.flatMap(({ sum, count }) => Array(count).fill(Math.min(Math.max(sum / count, low), most)));
  return places.map((place, i) => place + i * gap);
}

function decidedInOrder() {
  return robots.filter(({ final }) => final.decision >= 0 && final.decision_time_s !== null)
    .sort((a, b) => a.final.decision_time_s - b.final.decision_time_s);
}

// Robots that decide alike in the same of so many parts of the run.
function decidedTogether(decided, parts) {
  const groups = new Map();
  for (const robot of decided) {
    const part = Math.min(Math.floor(robot.final.decision_time_s / END_S * parts), parts - 1);
    const key = `${part}/${robot.final.decision}`;
    groups.set(key, [...groups.get(key) ?? [], robot]);
  }
  return [...groups.values()];
}

const meanOf = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;

const FAR_OFF = 60; // px from its place at which a flag no longer tells when

// A flag for each decision, in order of time, side by side where they come together; where so many do not fit or
// come too far from their times, one for the robots that decide alike at about the same time.
function decisionFlags(left, width) {
  const decided = decidedInOrder();
  const fits = (flags) => flags.length < 2 || (flags.every(({ x, place }) => Math.abs(x - place) <= FAR_OFF)
    && flags.every((flag, i) => !i || flag.place - flags[i - 1].place >= 2 * flag.radius));
  const single = placedFlags(decided.map((robot) => [robot]), left, width, FLAG_STEP);
  if (fits(single)) return single;
  for (let parts = Math.max(Math.floor(width / GROUP_STEP), 1); ; parts--) {
    const flags = placedFlags(decidedTogether(decided, parts), left, width, GROUP_STEP);
    if (parts === 1 || fits(flags)) return flags;
  }
}

function placedFlags(groups, left, width, step) {
  const radius = step / 2 - 1.5;
  const flags = groups.map((group) => ({
    robots: group, robot: group[0], radius, time: group[0].final.decision_time_s,
    x: left + width * meanOf(group.map(({ final }) => final.decision_time_s)) / END_S,
    belief: meanOf(group.map(({ final }) => final.belief_at_decision ?? 0.5)),
    name: group.length > 1 ? `\u00d7${group.length}` : group[0].name,
  })).sort((a, b) => a.x - b.x);
  const places = spreadOut(flags.map(({ x }) => x), step, left + radius, left + width - radius);
  return flags.map((flag, i) => ({ ...flag, place: places[i] }));
}

function flagNear(x, y) {
  const near = ({ place, radius }) => Math.hypot(place - x, FLAG_RADIUS + 2 - y) <= radius + 2;
  return beliefChart.box.flags.find(near) ?? null;
}

function flagNote({ robots: group }) {
  const times = group.map(({ final }) => final.decision_time_s), first = group[0];
  const names = group.map(({ name }) => name);
  if (group.length === 1) return [`Robot ${first.name} decides: ${DECISION_WORDS[first.final.decision]}`, [["at", bothTimes(times[0])]]];
  return [`${group.length} robots decide: ${DECISION_WORDS[first.final.decision]}`, [
    ["from", bothTimes(times[0])], ["to", bothTimes(times[times.length - 1])],
    ["robots", names.length > 8 ? `${names.slice(0, 7).join(", ")} \u2026` : listed(names)],
  ]];
}

function beliefBox(width, height) {
  const left = 34, right = 10;
  const flags = decisionFlags(left, width - left - right);
  const top = flags.length ? FLAG_ROOM : 10;
  const box = { left, top, width: width - left - right, height, flags };
  box.x = (t) => box.left + box.width * t / END_S;
  box.y = (p) => box.top + box.height * (1 - p);
  box.time = (x) => Math.min(Math.max((x - box.left) / box.width, 0), 1) * END_S;
  box.total = box.top + box.height + 26;
  return box;
}

// Thresholds are those of beliefs, and not every strategy decides by them or tells them.
const hasLimits = () => run.rule.by_belief && hasBelief;

function drawBeliefFrame(context, box, followed) {
  const limit = run.rule.credible_threshold, right = box.left + box.width;
  if (hasLimits()) {
    context.fillStyle = colours["still-soft"];
    context.fillRect(box.left, box.y(1), box.width, box.y(limit) - box.y(1));
    context.fillStyle = colours["vibrating-soft"];
    context.fillRect(box.left, box.y(1 - limit), box.width, box.y(0) - box.y(1 - limit));
  }
  drawTooEarly(context, box, followed);
  context.lineWidth = 1;
  const scale = hasBelief ? [[0, "line-strong"], [0.5, "line"], [1, "line-strong"]] : [[0, "line-strong"]];
  for (const [p, colour] of scale) {
    context.strokeStyle = colours[colour];
    line(context, box.left, crisp(box.y(p)), right, crisp(box.y(p)));
  }
  context.setLineDash([5, 3]);
  const limits = hasLimits() ? [[limit, colours.still], [1 - limit, colours.vibrating]] : [];
  for (const [p, colour] of limits) {
    context.strokeStyle = colour;
    line(context, box.left, crisp(box.y(p)), right, crisp(box.y(p)));
  }
  context.setLineDash([]);
  drawBeliefTicks(context, box);
}

function drawBeliefTicks(context, box) {
  context.font = `11.5px ${FONT}`;
  context.fillStyle = colours["ink-2"];
  context.textBaseline = "middle";
  context.textAlign = "right";
  for (const p of hasBelief ? [0, 0.5, 1] : []) context.fillText(String(p), box.left - 7, box.y(p));
  context.textBaseline = "top";
  const steps = timeSteps(END_S, Math.max(box.width / 70, 2));
  context.strokeStyle = colours["line-strong"];
  steps.forEach((t, i) => {
    line(context, crisp(box.x(t)), box.y(0), crisp(box.x(t)), box.y(0) + 4);
    context.textAlign = i === 0 ? "left" : box.x(t) > box.left + box.width - 18 ? "right" : "center";
    context.fillText(i === steps.length - 1 ? `${t} s` : String(t), box.x(t), box.y(0) + 8);
  });
}

// Where along the chart a text of some width at height y hides the fewest points of the curves, and how many;
// left of x = until if that is given.
function quietPlace(box, width, y, until = box.left + box.width) {
  const s = run.samples, room = until - box.left - width - 14;
  let best = { count: Infinity, x: 0 };
  for (let i = 0; i <= 6; i++) {
    const x = box.left + 7 + room * i / 6;
    let count = 0;
    for (let row = 0; row < s.belief_below.length; row++) {
      const px = box.x(s.time_s[row]);
      if (px > x - 4 && px < x + width + 4 && Math.abs(box.y(s.belief_below[row]) - y) < 9) count++;
    }
    if (count < best.count) best = { count, x };
  }
  return best;
}

// What lies beyond the thresholds: two texts, where the curves leave room; none where they would be hidden.
function beliefWords(context, box) {
  const limit = run.rule.credible_threshold;
  context.font = WORDS_FONT;
  // Beliefs are those of two kinds.
  if (KIND_COUNT > 2 || !hasLimits()) return tooEarlyWords(context, box);
  const words = [
    [`above ${limit}: ${DECISION_WORDS[STILL]}`, box.y(limit) + 12, STILL],
    [`below ${lowerLimit()}: ${DECISION_WORDS[VIBRATING]}`, box.y(1 - limit) - 12, VIBRATING],
  ].map(([text, y, decision]) => {
    const { width } = context.measureText(text);
    return { text, y, decision, width, ...quietPlace(box, width, y) };
  }).filter(({ count }) => count <= MOST_HIDDEN);
  return [...words, ...tooEarlyWords(context, box)];
}

// The name of the hatched part, at the height where it hides least; none where it does not fit.
function tooEarlyWords(context, box) {
  const until = box.x(tooEarlyUntil(null)), widthOf = (text) => context.measureText(text).width;
  const text = ["too early to decide", "too early"].find((words) => until - box.left >= widthOf(words) + 14);
  if (!hasGate || !text) return [];
  const width = widthOf(text);
  return [0.75, 0.25, 0.6, 0.4].map((p) => {
    const y = box.y(p);
    return { text, y, decision: null, width, ...quietPlace(box, width, y, until) };
  }).sort((a, b) => a.count - b.count).slice(0, 1);
}

function drawBeliefWords(context, words) {
  context.font = WORDS_FONT;
  context.textAlign = "left";
  context.textBaseline = "middle";
  for (const { text, x, y, width, decision } of words) {
    context.globalAlpha = 0.8;
    context.fillStyle = colours.paper;
    context.fillRect(x - 3, y - 8, width + 6, 16);
    context.globalAlpha = 1;
    context.fillStyle = decision === null ? colours["ink-2"] : colours.of[decision];
    context.fillText(text, x, y);
  }
}
