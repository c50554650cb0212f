// The time in the page's address, so that a moment can be sent on: #t=600, and #t=600&robot=3.

function readAddress() {
  const words = new URLSearchParams(location.hash.slice(1));
  const t = words.has("t") ? Number.parseFloat(words.get("t")) : NaN;
  return {
    t: Number.isFinite(t) ? Math.min(Math.max(t, 0), END_S) : null,
    robot: robots.find(({ name }) => name === words.get("robot")) ?? null,
  };
}

let addressTimer = 0;

// Waits for rest: browsers allow few changes of address a second.
function writeAddress(t, followed) {
  clearTimeout(addressTimer);
  addressTimer = setTimeout(() => {
    const words = `#t=${Number(t.toFixed(2))}${followed ? `&robot=${followed.name}` : ""}`;
    if (words === location.hash) return;
    try {
      history.replaceState(null, "", words);
    } catch {
      // A browser that does not let a file change its address: the page works without.
    }
  }, 400);
}
