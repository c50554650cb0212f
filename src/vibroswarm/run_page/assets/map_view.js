// The map beside its uncertainty: each tile in a colour that is the lighter the larger its number, and the number.

// Stops of cividis, which is alike for all colour vision, and in grey.
const CIVIDIS = [[0, 34, 78], [65, 77, 107], [124, 123, 120], [188, 174, 108], [254, 232, 56]];
const LEAST_NUMBERED = 24; // px of the side of a tile that has its number
const mapViews = [
  { id: "map-probability", most: 1, of: (p) => p },
  { id: "map-uncertainty", most: 0.5, of: (p) => Math.sqrt(p * (1 - p)) },
];
let mapKey = "";

function cividis(share) {
  const at = Math.min(Math.max(share, 0), 1) * (CIVIDIS.length - 1), low = Math.min(Math.floor(at), CIVIDIS.length - 2);
  const mixed = CIVIDIS[low].map((value, k) => Math.round(value + (at - low) * (CIVIDIS[low + 1][k] - value)));
  return `rgb(${mixed.join(",")})`;
}

function layOutMaps() {
  byId("map-section").hidden = !run.maps;
  mapKey = "";
  if (!run.maps) return;
  const f = run.floor, slope = (f.rows * f.tile_height_m) / (f.columns * f.tile_width_m);
  for (const view of mapViews) byId(view.id).style.width = "100%";
  for (const view of mapViews) {
    view.width = Math.max(byId(view.id).clientWidth, 40);
    view.context = fitCanvas(byId(view.id), view.width, view.width * slope);
  }
}

function drawMaps(t, followed) {
  if (!run.maps) return;
  const whose = followed && run.maps.count > 1 ? followed : null;
  const key = `${Math.floor(t / run.maps.step_s + 1e-6)}/${whose ? whose.id : ""}`;
  if (key === mapKey) return;
  mapKey = key;
  say(byId("map-lead"), whose ? `Robot ${whose.name}, by what it has heard.` : "All samples together.");
  for (const view of mapViews) drawMapView(view, t, whose);
}

function drawMapView(view, t, whose) {
  const { context, width, most, of } = view, f = run.floor;
  const side = width / f.columns, height = side * f.tile_height_m / f.tile_width_m;
  for (let tile = 0; tile < f.rows * f.columns; tile++) {
    const column = tile % f.columns, row = (tile - column) / f.columns, value = of(tileBelief(tile, t, whose));
    context.fillStyle = cividis(value / most);
    context.fillRect(column * side, row * height, side, height);
    if (Math.min(side, height) < LEAST_NUMBERED) continue;
    const ink = value / most > 0.5 ? "#000" : "#fff";
    stampWords(context, String(Math.round(100 * value)), (column + 0.5) * side, (row + 0.5) * height, 12, ink);
  }
}
