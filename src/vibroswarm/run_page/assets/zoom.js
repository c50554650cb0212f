// A nearer look at the floor: how much larger, and what is in the middle (m).

const MOST_ZOOM = 12, ZOOM_STEP = 1.5;
const zoom = { factor: 1, x: run.arena.width_m / 2, y: run.arena.height_m / 2, dragged: false };

// Keeps what is seen within the walls.
function clampZoom() {
  const { width_m: width, height_m: height } = run.arena, halfX = width / 2 / zoom.factor, halfY = height / 2 / zoom.factor;
  zoom.x = Math.min(Math.max(zoom.x, halfX), width - halfX);
  zoom.y = Math.min(Math.max(zoom.y, halfY), height - halfY);
}

// Enlarges so that a place on the canvas stays where it is.
function zoomAt(by, place) {
  const { view } = arena, x = view.toX(place.x), y = view.toY(place.y), before = zoom.factor;
  zoom.factor = Math.min(Math.max(zoom.factor * by, 1), MOST_ZOOM);
  if (zoom.factor < 1.001) zoom.factor = 1;
  const share = before / zoom.factor;
  zoom.x = x + (zoom.x - x) * share;
  zoom.y = y + (zoom.y - y) * share;
  clampZoom();
}

function buildZoom(onChange, placeOf) {
  const canvas = byId("actors");
  const middle = () => placeOf() ?? { x: arena.view.width / 2, y: arena.view.height / 2 };
  const change = (by, place) => {
    zoomAt(by, place);
    onChange();
  };
  byId("zoom-in").addEventListener("click", () => change(ZOOM_STEP, middle()));
  byId("zoom-out").addEventListener("click", () => change(1 / ZOOM_STEP, middle()));
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey) return; // the wheel alone scrolls the page
    event.preventDefault();
    change(Math.exp(-Math.min(Math.max(event.deltaY, -100), 100) / 250), placeIn(canvas, event));
  }, { passive: false });
  let last = null;
  canvas.addEventListener("pointerdown", (event) => {
    zoom.dragged = false;
    if (zoom.factor > 1) last = placeIn(canvas, event);
  });
  addEventListener("pointerup", () => (last = null));
  canvas.addEventListener("pointermove", (event) => {
    if (!last || !event.buttons) return;
    const place = placeIn(canvas, event);
    if (!zoom.dragged && Math.hypot(place.x - last.x, place.y - last.y) < 4) return;
    zoom.dragged = true;
    zoom.x -= (place.x - last.x) / arena.view.scale;
    zoom.y += (place.y - last.y) / arena.view.scale;
    last = place;
    clampZoom();
    onChange();
  });
}

function drawZoom() {
  byId("zoom-out").disabled = zoom.factor === 1;
  byId("zoom-in").disabled = zoom.factor === MOST_ZOOM;
  byId("actors").style.touchAction = zoom.factor > 1 ? "none" : "";
}
