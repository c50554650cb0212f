// The table, robot by robot: what it does now, what it decided, and its counts over the run.

// Columns that no robot of this run has are left out.
const ROSTER_BELIEF = hasBelief ? ["p"] : [], ROSTER_THEN = hasBelief ? ["p then"] : [];
const ROSTER_COUNTS = [
  ...(run.estimates ? [["estimate", "estimate"]] : []),
  ...(hasPosterior ? [["alpha", "\u03b1"], ["beta", "\u03b2"]] : []),
  ["samples", "samples"], ["sent", "sent"], ["messages_received", "received"],
];
const ROSTER_HEADS = [
  ["", ["#"]], ["Now", ["doing", ...ROSTER_BELIEF]], ["Decision", ["", "after", ...ROSTER_THEN]],
  ["By the end", ROSTER_COUNTS.map(([, head]) => head)],
];
const rosterRows = [];

function buildRoster(onChoose) {
  const groups = make("tr", ""), names = make("tr", "");
  for (const [group, columns] of ROSTER_HEADS) {
    const head = make("th", "group", group);
    head.colSpan = columns.length;
    head.scope = "colgroup";
    groups.append(head);
    columns.forEach((name, i) => {
      const ofWords = ["doing", ""].includes(name) ? " words" : "";
      const cell = make("th", i === 0 && group ? `first${ofWords}` : "", name || "says");
      cell.scope = "col";
      names.append(cell);
    });
  }
  const body = make("tbody", "");
  for (const robot of robots) body.append(rosterRow(robot, onChoose));
  byId("roster").replaceChildren(make("caption", "unseen", "Robots"), make("thead", "", groups, names), body);
}

function rosterRow(robot, onChoose) {
  const final = { ...robot.final, estimate: run.estimates?.of_robots[robots.indexOf(robot)] };
  const row = make("tr", "");
  const choose = make("button", "pip", robot.name);
  choose.type = "button";
  choose.setAttribute("aria-label", `Follow robot ${robot.name}`);
  row.addEventListener("click", () => onChoose(robot));
  const cell = (name, content, className = "") => {
    const element = make("td", className, ...[content].flat());
    element.dataset.column = name;
    return element;
  };
  const head = make("th", "", choose);
  head.scope = "row";
  const state = cell("state", "", "first words");
  const belief = ROSTER_BELIEF.map(() => cell("belief", ""));
  const then = final.belief_at_decision === null ? "\u2013" : probability(final.belief_at_decision);
  row.append(head, state, ...belief,
    cell("decision", verdictOf(final), "first words"),
    cell("decision_time_s", final.decision_time_s === null ? "\u2013" : exactSeconds(final.decision_time_s)),
    ...ROSTER_THEN.map(() => cell("belief_at_decision", then)),
    ...ROSTER_COUNTS.map(([name], i) => cell(name, String(final[name] ?? "\u2013"), i === 0 ? "first" : "")));
  rosterRows.push({ robot, row, choose, state, belief });
  return row;
}

// The decision in a word, with a tick or a cross; said in full to those who do not see it.
function verdictOf(final) {
  const words = VOTE_WORDS[final.decision];
  if (final.decision < 0 || run.truth.decision === null) return [words];
  const right = final.decision === run.truth.decision;
  const sign = make("span", "", right ? "\u2713" : "\u2717");
  sign.setAttribute("aria-hidden", "true");
  return [`${words} `, sign, make("span", "unseen", right ? "right" : "wrong")];
}

function drawRoster(t, followed) {
  for (const { robot, row, choose, state, belief } of rosterRows) {
    const mind = mindAt(robot, t), pose = poseAt(robot, t);
    say(state, pose ? doingWords(robot, pose, t) : "\u2013");
    for (const element of belief) say(element, probability(mind.belief));
    mark(choose, "data-decision", String(mind.decision));
    mark(choose, "aria-pressed", String(robot === followed));
    row.classList.toggle("followed", robot === followed);
  }
}
