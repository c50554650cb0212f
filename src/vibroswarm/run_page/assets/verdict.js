// The header: what the swarm came to, when, how sure; and how many have decided by now.

const SIGNS = {
  right: "M4 10.5l4 4 8-9", wrong: "M5 5l10 10M15 5L5 15", split: "M10 17v-6L4 4M10 11l6-7",
  incomplete: "M5 3h10M5 17h10M6 3c0 7 8 7 8 14M14 3c0 7-8 7-8 14", truth_undefined: "M4 8h12M4 13h12", estimates: "M4 8c4-4 8 4 12 0M4 13c4-4 8 4 12 0",
};
const BADGES = {
  right: "Right", wrong: "Wrong", split: "Split", incomplete: "Undecided", truth_undefined: "Consensus", estimates: "Estimates",
};

function byDecision(decision) {
  return robots.filter((robot) => robot.final.decision === decision);
}

function verdictLine() {
  if (run.estimates) return run.estimates.told ? `The robots estimate ${run.estimates.told}.` : "No robot has an estimate.";
  const side = DECISION_WORDS[robots[0]?.final.decision];
  const open = byDecision(-1).length;
  const votes = SIDES.map((side) => [byDecision(side).length, ANSWERS ? DECISION_WORDS[side] : VOTE_WORDS[side]])
    .filter(([count]) => count > 0 || SIDES.length === 2).map(([count, word]) => `${count}\u00a0say\u00a0${word}`);
  return {
    right: `The swarm is right: ${ANSWERS ? "it says" : "the floor is"} ${side}.`,
    wrong: `The swarm is wrong: it says ${side}.`,
    split: `The swarm is split: ${votes.join(", ")}.`,
    incomplete: open === robots.length ? "No robot has decided." : `${open} of ${robots.length} robots never decided.`,
    truth_undefined: `The swarm agrees: ${side}.`,
  }[run.outcome.consensus];
}

// The question and the right answer, in one line.
function taskLine() {
  const { fill_ratio: fill, decision: right } = run.truth, edge = run.rule.boundary;
  if (run.estimates) return `What is the ${run.estimates.asked}? Truth: ${run.estimates.true}.`;
  if (ANSWERS) {
    const vibrates = KIND_COUNT > 2 ? "" : ` (${percent(fill)} of the floor vibrates)`;
    const none = SIDES.length > 2 ? "none" : "neither";
    const choices = new Intl.ListFormat("en-GB", { type: "disjunction" }).format(SIDES.map((side) => DECISION_WORDS[side]));
    return `${choices}? `
      + `Truth${AT_END}: ${right !== null ? DECISION_WORDS[right] : run.rule.asked_anew ? "depends on the last answer of each robot" : none}${vibrates}.`;
  }
  const truth = right === null ? "neither" : right === VIBRATING ? "yes" : "no";
  return `Does more than ${percent(edge)} of the floor vibrate? Truth${AT_END}: ${truth} (${percent(fill)}).`;
}

function verdictMore() {
  if (run.estimates) return run.estimates.told && run.estimates.sure;
  if (run.rule.asked_anew) return "Each robot is asked again after it has answered, so some answers may be right.";
  if (run.truth.decision !== null) return rightAndWrong();
  return ANSWERS ? `${SIDES.length > 2 ? "No" : "Neither"} answer is right.` : "The share is exactly the boundary, so neither answer is right.";
}

// Where there is no consensus: how those that decided did.
function rightAndWrong() {
  const right = byDecision(run.truth.decision).length, wrong = robots.length - right - byDecision(-1).length;
  if (!["split", "incomplete"].includes(run.outcome.consensus) || right + wrong === 0) return "";
  return `Decided right: ${right}, wrong: ${wrong}.`;
}

// Confidence: probability of the own decision when it was made.
function certainties() {
  return robots.filter((robot) => robot.final.belief_at_decision !== null && robot.final.decision >= 0)
    .map(({ final }) => (final.decision === STILL ? final.belief_at_decision : 1 - final.belief_at_decision));
}

function verdictFacts() {
  const sure = certainties(), count = run.samples.time_s.length;
  const misread = run.samples.time_s.reduce((n, _, row) => n + (isMisread(row) ? 1 : 0), 0);
  const mean = sure.reduce((sum, value) => sum + value, 0) / sure.length;
  const when = run.outcome.time_s, apart = when !== null && run.outcome.consensus === "split";
  const votes = SIDES.map((decision) => [byDecision(decision).length, DECISION_WORDS[decision]])
    .filter(([count]) => count > 0).map(([count, word]) => `${count} of ${robots.length} ${count === 1 ? "says" : "say"}: ${word}`);
  const open = byDecision(-1).length, undecided = open ? `${open} of ${robots.length} undecided` : "";
  const ofDecisions = [
    [apart ? "Last decision after" : "Consensus after", when === null ? "none" : exactSeconds(when), "consensus",
      when === null || when < 60 ? "" : minutes(when)],
    ["Confidence", sure.length ? probability(mean) : "none",
      "certainty", sure.length ? `lowest ${probability(Math.min(...sure))}` : ""],
  ];
  return [
    ...(run.estimates ? [] : ofDecisions), // a task that asks for a number needs no decision
    ["Robots", votes.join(", ") || undecided, "votes", votes.length ? undecided : ""],
    ["Samples", whole(count), "samples", count && !run.floor.has_values ? `${percent(misread / count)} misread` : ""],
  ];
}

function signOf(outcome) {
  const space = "http://www.w3.org/2000/svg";
  const sign = document.createElementNS(space, "svg"), path = document.createElementNS(space, "path");
  sign.setAttribute("viewBox", "0 0 20 20");
  sign.setAttribute("aria-hidden", "true");
  path.setAttribute("d", SIGNS[outcome]);
  sign.append(path);
  return sign;
}

function buildVerdict() {
  const outcome = run.estimates ? "estimates" : run.outcome.consensus;
  document.querySelector(".verdict").dataset.outcome = outcome;
  byId("run-name").textContent = run.title;
  byId("verdict-badge").replaceChildren(signOf(outcome), BADGES[outcome]);
  say(byId("verdict-line"), verdictLine());
  say(byId("task"), [...run.notes, taskLine()].join(" "));
  say(byId("outcome-time"), `Outcome, at the end of the run (${minutes(END_S)})`);
  say(byId("verdict-more"), verdictMore());
  byId("facts").replaceChildren(...verdictFacts().map(([term, value, name, more]) => {
    const fact = make("div", "fact", make("dt", "", term), make("dd", "", make("span", "", value)));
    fact.dataset.fact = name;
    if (more) fact.lastChild.append(" ", make("small", "", more));
    return fact;
  }));
  say(byId("now-robots"), String(robots.length));
  byId("pips").replaceChildren(...robots.map((robot) => make("li", "pip", robot.name)));
}

function drawVerdict(t) {
  say(byId("now-time"), bothTimes(t));
  robots.forEach((robot, i) => {
    const { decision } = mindAt(robot, t), pip = byId("pips").children[i];
    if (pip.dataset.decision === String(decision)) return;
    pip.dataset.decision = decision;
    pip.setAttribute("aria-label", `Robot ${robot.name}: ${DECISION_WORDS[decision]}`);
  });
  const count = robots.filter((robot) => hasDecided(robot, t)).length;
  if (byId("now-decided").textContent === String(count)) return;
  say(byId("now-decided"), String(count));
  say(byId("announce"), `${count} of ${robots.length} decided.`);
}
