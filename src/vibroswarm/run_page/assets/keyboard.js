// Keys for everything that the mouse can do with time.

function watchKeys(actions) {
  const keys = {
    " ": () => actions.toggle(),
    ArrowLeft: (event) => actions.move(event.shiftKey ? -60 : -5),
    ArrowRight: (event) => actions.move(event.shiftKey ? 60 : 5),
    ",": () => actions.move(-run.time.tick_s),
    ".": () => actions.move(run.time.tick_s),
    Home: () => actions.seek(0),
    End: () => actions.seek(END_S),
    "+": () => actions.changeSpeed(1),
    "=": () => actions.changeSpeed(1),
    "-": () => actions.changeSpeed(-1),
    n: () => actions.seek(nextEvent(actions.now())),
    p: () => actions.seek(previousEvent(actions.now())),
    d: toggleTheme,
    "?": () => byId("help").showModal(),
    Escape: () => actions.follow(null),
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || byId("help").open) return;
    const target = event.target;
    if (target.tagName === "SELECT") return;
    if (event.key === " " && target.tagName === "BUTTON") {
      if (target.matches(":focus-visible")) return; // reached by keyboard: the space bar presses it
      target.blur();
    }
    if (target.id === "roster-frame" && event.key.startsWith("Arrow")) return; // it scrolls
    const robot = robots.find(({ name }) => name === event.key);
    const act = robot ? () => actions.follow(robot) : keys[event.key];
    if (!act) return;
    event.preventDefault();
    act(event);
  });
  byId("help-open").addEventListener("click", () => byId("help").showModal());
}
