// Moments worth a jump: the first permitted decision, decisions, faults.

const EVENT_TIMES_S = [...new Set([
  FIRST_PERMITTED_S, ...decidedInOrder().map(({ final }) => final.decision_time_s), ...run.faults.map(({ from_s }) => from_s),
])].filter((t) => t > 0 && t <= END_S).sort((a, b) => a - b);
const SAME_MOMENT_S = 1e-6;

const nextEvent = (t) => EVENT_TIMES_S.find((time) => time > t + SAME_MOMENT_S) ?? END_S;
const previousEvent = (t) => EVENT_TIMES_S.filter((time) => time < t - SAME_MOMENT_S).pop() ?? 0;

// A loop is set in two steps (start, end) and cleared by a third.
function nextLoop(loop, t) {
  if (!loop) return { from: t, to: null };
  return loop.to === null && t > loop.from ? { from: loop.from, to: t } : null;
}

function loopWords(loop) {
  if (!loop) return "Loop from here";
  return loop.to === null ? `Loop ${seconds(loop.from)} to here` : `End loop ${seconds(loop.from)} \u2013 ${seconds(loop.to)}`;
}

function drawLoop(loop) {
  const button = byId("loop"), mark = byId("scrub-loop");
  say(button, loopWords(loop));
  button.setAttribute("aria-pressed", String(loop !== null));
  mark.hidden = !loop;
  if (!loop) return;
  mark.style.left = `${100 * loop.from / END_S}%`;
  mark.style.width = `${100 * ((loop.to ?? loop.from) - loop.from) / END_S}%`;
}
