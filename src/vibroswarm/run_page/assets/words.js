// How numbers and findings are said.

const STATE_WORDS = { drive: "driving", turn: "turning", avoid: "avoiding", stop: "sampling" };

const seconds = (value) => `${value.toFixed(1)} s`;
const exactSeconds = (value) => `${Number(value.toFixed(3))} s`;
const minutes = (value) => {
  const tenths = Math.round(10 * value), whole = Math.floor(tenths / 600), rest = (tenths % 600) / 10; // never 60 s
  return whole ? `${whole} min ${rest} s` : `${rest} s`;
};
// Seconds, and from a minute on minutes beside them.
const bothTimes = (value) => (value < 60 ? seconds(value) : `${seconds(value)} (${minutes(value)})`);
const clockMinutes = (value) => `${Math.floor(value / 60)}:${String(Math.floor(value % 60)).padStart(2, "0")}`;
const whole = (value) => String(value).replace(/\B(?=(\d{3})+$)/g, "\u202f");
const percent = (share) => `${Number((100 * share).toFixed(1))} %`;
const ratio = (share) => String(Number(share.toFixed(6)));

// A decision is about the boundary: "mostly" only where that is one half.
const ANSWERS = run.rule.answers;
const AT_END = run.floor.changes.length ? " at the end" : ""; // of what is true on a floor that changes
const DECISION_WORDS = ANSWERS
  ? { "-1": "undecided", ...ANSWERS.map((words) => `\u201c${words}\u201d`) }
  : run.rule.boundary === 0.5 ? { "-1": "undecided", 0: "mostly still", 1: "mostly vibrating" }
  : {
    "-1": "undecided",
    0: `less than ${percent(run.rule.boundary)} vibrating`,
    1: `more than ${percent(run.rule.boundary)} vibrating`,
  };
// The same in one word, where the boundary goes without saying.
const VOTES = ANSWERS ?? (run.rule.boundary === 0.5 ? ["still", "vibrating"] : ["less", "more"]);
const VOTE_WORDS = { "-1": "undecided", ...VOTES };
const SIDES = VOTES.map((_, side) => side);

// Below which belief a robot decides 1; as exact as the threshold p_c is given.
const lowerLimit = () => Number((1 - run.rule.credible_threshold).toPrecision(6));

// Three places, and never a certainty: where a belief is 0 or 1, rounding has made it so.
function probability(value) {
  if (Number.isNaN(value)) return "\u2013";
  if (value > 0.9995) return "> 0.999";
  if (value < 0.0005) return "< 0.001";
  return value.toFixed(3);
}

// "0, 2 and 5"
function listed(words) {
  return words.length < 2 ? words.join("") : `${words.slice(0, -1).join(", ")} and ${words[words.length - 1]}`;
}

function stateWord(kind) {
  return STATE_WORDS[kind] ?? kind;
}

// An element with a class, attributes and children; text is always text.
function make(tag, className, ...children) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  element.append(...children);
  return element;
}

// Text is set only where it changes, which spares the browser a layout.
function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// The same for attributes.
function mark(element, name, value) {
  if (element.getAttribute(name) !== value) element.setAttribute(name, value);
}

const byId = (id) => document.getElementById(id);
