// Order and excerpts of search results (docs/search_texts.py). Sphinx counts neither how often a page has a word, nor
// whether a reader looks for a guide or for a name of the API: here guides come first, unless the query is a name.
const queryWords = () => {
  const query = new URLSearchParams(window.location.search).get("q") ?? "";
  return query.toLowerCase().split(/[^\p{Letter}\p{Number}_-]+/u).filter((word) => word.length > 1);
};

// Each word, and in prose also other endings of it.
const stemOf = (word) => (word.length > 4 && !word.includes("_") ? word.replace(/(ies|es|s|ing|ed|y)$/, "") : word);

const countOf = (text, word) => text.toLowerCase().split(stemOf(word)).length - 1;

// How well a section answers: its rarest word counts, words of its title count as eight.
const weightOf = ([, title, text], words) =>
  Math.min(...words.map((word) => countOf(text, word) + 8 * countOf(title, word)));

const bestSection = (page, words) => {
  let best = null;
  for (const section of SECTION_TEXTS[page] ?? []) {
    const weight = weightOf(section, words);
    if (!best || weight > best.weight) best = { section, weight };
  }
  return best;
};

const LISTS = ["commands", "scenario", "glossary", "paper"];
// Lists name everything, and explain little.
const isList = (page) => LISTS.includes(page);
const isName = (words) => words.some((word) => word.includes("_"));

var Scorer = {
  score: ([page, title, anchor, , score, , kind]) => {
    const words = queryWords();
    if (kind === "object") {
      if (isName(words)) return score + 30;
      return title === `vibroswarm.${words.join("")}` ? 20 : score - 40; // a public name comes early, others last
    }
    const texts = SECTION_TEXTS[page];
    if (!texts || !words.length) return score - 20;
    const whole = ["", title, texts.map(([, head, text]) => `${head} ${text}`).join(" ")];
    const head = `${page.replaceAll("-", " ")} ${texts[0]?.[1] ?? ""}`;
    const inTitle = words.filter((word) => countOf(head, word)).length / words.length;
    const phrase = words.length > 1 ? countOf(whole[2], words.join(" ")) : 0;
    const best = bestSection(page, words)?.weight ?? 0;
    const found = 4 * Math.log2(1 + best) + 2 * Math.log2(1 + weightOf(whole, words)) + 10 * inTitle
      + 3 * Math.log2(1 + phrase);
    return found + (anchor ? 0 : 1) + Math.min(score, 15) / 4 - (isList(page) ? 9 : 0);
  },
  objNameMatch: 11, objPartialMatch: 6, objPrio: { 0: 15, 1: 5, 2: -5 }, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};

const excerptOf = (text, words) => {
  const lower = text.toLowerCase();
  const places = words.map((word) => lower.indexOf(stemOf(word))).filter((place) => place >= 0);
  if (!places.length) return text.slice(0, 180);
  const from = Math.max(0, Math.min(...places) - 60), start = from ? lower.indexOf(" ", from) + 1 : 0;
  return `${start ? "… " : ""}${text.slice(start, start + 200)}${start + 200 < text.length ? " …" : ""}`;
};

// Adds to a result the excerpt of its best section, with a link to that section.
const addExcerpt = (item) => {
  const link = item.querySelector("a"), words = queryWords();
  if (!link || item.querySelector(".excerpt") || item.classList.contains("kind-object")) return;
  const [file, anchor] = link.getAttribute("href").split("#"), page = file.replace(/\.html$/, "");
  const own = anchor && (SECTION_TEXTS[page] ?? []).find(([id]) => id === anchor);
  const section = own || bestSection(page, words)?.section;
  if (!section) return;
  const line = document.createElement("p");
  line.className = "excerpt";
  if (!own && section[0] && section !== SECTION_TEXTS[page][0]) {
    const to = document.createElement("a");
    to.href = `${file}#${section[0]}`;
    to.textContent = section[1];
    line.append(to, ": ");
  }
  line.append(excerptOf(section[2], words));
  item.append(line);
};

window.addEventListener("DOMContentLoaded", () => {
  const results = document.getElementById("search-results");
  if (!results) return;
  new MutationObserver(() => results.querySelectorAll("li").forEach(addExcerpt))
    .observe(results, { childList: true, subtree: true });
});
