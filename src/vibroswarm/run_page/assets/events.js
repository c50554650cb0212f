// Moments worth a jump: the first permitted decision, decisions, faults.

const EVENT_TIMES_S = [...new Set([
  FIRST_PERMITTED_S, ...decidedInOrder().map(({ final }) => final.decision_time_s), ...run.faults.map(({ from_s }) => from_s),
])].filter((t) => t > 0 && t <= END_S).sort((a, b) => a - b);
const SAME_MOMENT_S = 1e-6;

const nextEvent = (t) => EVENT_TIMES_S.find((time) => time > t + SAME_MOMENT_S) ?? END_S;
const previousEvent = (t) => EVENT_TIMES_S.filter((time) => time < t - SAME_MOMENT_S).pop() ?? 0;
