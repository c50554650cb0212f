// The footer and the lines of explanation: what the run was, for whoever wants to make it again.

function buildDetails() {
  const f = run.floor, counted = (count, thing) => `${count} ${thing}${count === 1 ? "" : "s"}`;
  const grid = `${counted(f.rows, "row")} \u00d7 ${counted(f.columns, "column")}`;
  const known = [
    ["Run", run.seed === null ? `recorded, session ${run.run + 1}` : `seed ${run.seed}, run ${run.run}`],
    ["Robots", `${robots.length}, ${exactCm(2 * run.body.radius_m)} across`],
    ["Floor", `${grid}, tiles of ${tileSize(f)}${f.name ? `, ${f.name}` : ""}`],
    [`${KIND_COUNT > 2 ? "Share of kind 1" : "Fill ratio"}${AT_END}`, ratio(run.truth.fill_ratio)],
    ["Strategy", run.strategy],
    ["Decides", ruleWords(run.rule)],
  ];
  byId("details").replaceChildren(...[...known, ...run.details].map(([name, text]) =>
    make("div", "", make("dt", "", name), make("dd", "", text))));
}

// When a robot decides: by its belief, a gate, both, or by what only its strategy knows.
function ruleWords(rule) {
  const gates = { total: "readings, own and received", received: "received bits", own: "own samples" };
  const words = [
    ...(rule.by_belief && (hasBelief || KIND_COUNT > 2) ? [`beyond ${rule.credible_threshold}`] : []),
    ...(rule.gated ? [`after more than ${rule.min_observations} ${gates[rule.gate] ?? rule.gate}`] : []),
  ];
  return words.join(", ") || "by a rule of its own";
}

function tileSize({ tile_width_m: width, tile_height_m: height }) {
  const [first, second] = [exactCm(width), exactCm(height)];
  return first === second ? first : `${first} \u00d7 ${second}`;
}

const exactCm = (metres) => `${Number((100 * metres).toFixed(2))} cm`;

function buildLeads() {
  const { boundary, credible_threshold: limit } = run.rule;
  const claim = ANSWERS ? `the answer is ${DECISION_WORDS[STILL]}`
    : boundary === 0.5 ? "most of the floor is still" : `less than ${percent(boundary)} of the floor vibrates`;
  if (KIND_COUNT > 2) {
    const lead = "Of more than two kinds of tile robots report no belief; a flag shows when a robot decided.";
    say(byId("belief-lead"), `${lead}${gateSentence()}`);
    return;
  }
  const rule = run.rule.by_belief
    ? `Above ${limit} it decides ${DECISION_WORDS[STILL]}, below ${lowerLimit()} ${DECISION_WORDS[VIBRATING]}.`
    : "It decides by a rule of its own.";
  say(byId("belief-lead"), hasBelief ? `p: its probability that ${claim}. ${rule}${gateSentence()}${bandSentence()}`
    : "These robots report no belief; flags show when they decided.");
  const { tested } = run.rule, moved = tested !== boundary;
  const line = moved ? `${percent(tested)}, the share of ones expected at the boundary,` : boundary;
  const opinion = run.rule.opinions
    ? "Under feedback this is the robot's opinion, not an estimate. " : "";
  byId("posterior-lead").replaceChildren(opinion,
    `Beta(\u03b1, \u03b2) after its latest own sample; ${hasBelief ? `left of ${line} is p, hatched the rest` : `hatched right of ${line}`}. `,
    make("span", "nobreak", `\u25b2 ${moved ? "ones expected on this floor" : "truth"}${AT_END}: `,
      make("b", "", moved ? percent(run.truth.ones) : ratio(run.truth.ones)), "."));
}
